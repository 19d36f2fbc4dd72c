// How many steps the sphere tracer takes along each pixel's ray.

import package::lib::frame::{frame, frame_ray};
import package::lib::march::{trace};
import package::world::bindings::{FAR, NO_PRIMITIVE};

@group(0) @binding(0) var layer: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let ray = frame_ray(id.xy);
    let hit = trace(ray.origin, ray.direction, FAR);
    textureStore(layer, id.xy, vec4f(vec3f(f32(hit.steps)), select(1.0, 0.0, hit.primitive == NO_PRIMITIVE)));
}
