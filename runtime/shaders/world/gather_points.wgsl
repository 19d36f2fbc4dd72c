// The technique's irradiance at given points with given normals.

import package::structs::{GatherInfo};
import package::technique::lookup::{gi_irradiance};

@group(0) @binding(0) var<uniform> gather: GatherInfo;
@group(0) @binding(1) var<storage, read> points: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> irradiance: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= gather.count {
        return;
    }
    let normal = points[2u * id.x + 1u].xyz;
    irradiance[id.x] = vec4f(gi_irradiance(points[2u * id.x].xyz, normal, normal), 1.0);
}
