// The set over its mesh, half of each. Where the set lies in front of the mesh by more than the start limit (1 % of the
// diagonal), or has no mesh behind it, the picture turns red: light is blocked there. Where it lies as much behind
// the mesh, or is missing, blue: light leaks.

import package::lib::frame::{frame, frame_position, frame_ray};
import package::primary::gbuffer::{gbuffer_albedo, gbuffer_depth, gbuffer_emission, gbuffer_normal};
import package::view::headlight::{headlight};
import package::view::set_picture::{set_picture};
import package::world::bindings::{FAR, world};

@group(0) @binding(10) var layer: texture_storage_2d<rgba32float, write>;

const BLOCKED = vec3f(0.9, 0.05, 0.02);
const LEAKS = vec3f(0.03, 0.2, 0.95);
const TINT: f32 = 0.6;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let ray = frame_ray(id.xy);
    let depth = textureLoad(gbuffer_depth, id.xy, 0);
    var mesh_color = vec3f(0.0);
    var mesh_t = FAR;
    if depth > 0.0 {
        let light = headlight(gbuffer_normal(id.xy), ray.direction);
        let emission = textureLoad(gbuffer_emission, id.xy, 0).rgb;
        mesh_color = textureLoad(gbuffer_albedo, id.xy, 0).rgb * light + emission;
        mesh_t = distance(frame_position(id.xy, depth), ray.origin);
    }
    let shown = set_picture(id.xy);
    var color = 0.5 * (mesh_color + shown.color);
    if shown.t < mesh_t - world.start_limit {
        color = mix(color, BLOCKED, TINT);
    } else if shown.t > mesh_t + world.start_limit {
        color = mix(color, LEAKS, TINT);
    }
    textureStore(layer, id.xy, vec4f(color, select(1.0, 0.0, min(mesh_t, shown.t) >= FAR)));
}
