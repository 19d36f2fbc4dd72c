// Hits of given rays, for tests and views of the tracer itself.

import package::lib::march::{trace, trace_soft_visibility};
import package::structs::{TracedRay, RayHit};
import package::world::bindings::{NO_PRIMITIVE};

@group(0) @binding(0) var<storage, read> rays: array<TracedRay>;
@group(0) @binding(1) var<storage, read_write> hits: array<RayHit>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&rays) {
        return;
    }
    let ray = rays[id.x];
    let hit = trace(ray.origin, ray.direction, ray.reach);
    var visibility = select(0.0, 1.0, hit.primitive == NO_PRIMITIVE);
    if ray.softness > 0.0 {
        visibility = trace_soft_visibility(ray.origin, ray.direction, ray.reach, ray.softness);
    }
    hits[id.x] = RayHit(hit.position, hit.t, hit.normal, hit.primitive, hit.albedo, hit.steps, hit.emission, visibility, hit.asked);
}
