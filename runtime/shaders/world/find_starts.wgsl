// Where lookups start from given points of a surface that a viewer sees: w is 0 where there is no free place.

import package::lib::march::{trace_start_seen};

// Local position, normal and direction to the viewer of each point.
@group(0) @binding(0) var<storage, read> points: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> starts: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&starts) {
        return;
    }
    starts[id.x] = trace_start_seen(points[3u * id.x].xyz, points[3u * id.x + 1u].xyz, points[3u * id.x + 2u].xyz);
}
