// How many primitives a query asks at the place that each pixel's ray meets: the length of the candidate list there, or
// what is left of the set by clusters.

import package::lib::candidates::{nearest_finite};
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
    var asked = vec4f(0.0);
    if hit.primitive != NO_PRIMITIVE {
        asked = vec4f(vec3f(f32(nearest_finite(hit.position, NO_PRIMITIVE).asked)), 1.0);
    }
    textureStore(layer, id.xy, asked);
}
