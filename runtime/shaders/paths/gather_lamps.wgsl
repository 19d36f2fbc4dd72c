// Direct irradiance of every lamp at given points with given normals.

import package::paths::lamps::{lamps_irradiance};
import package::tracer::sights::{sight_start};

// Position and normal of each point.
@group(0) @binding(0) var<storage, read> points: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> irradiance: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&irradiance) {
        return;
    }
    let normal = points[2u * id.x + 1u].xyz;
    let start = sight_start(points[2u * id.x].xyz, normal);
    irradiance[id.x] = vec4f(lamps_irradiance(start.xyz, normal) * start.w, 1.0);
}
