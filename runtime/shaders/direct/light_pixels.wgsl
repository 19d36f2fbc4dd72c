// Direct irradiance (suns, spots, points; shadows included) at every pixel of the G-buffer.

import package::lib::frame::{frame, frame_position, frame_towards_viewer};
import package::lib::lights::{direct_irradiance};
import package::primary::gbuffer::{gbuffer_depth, gbuffer_normal, gbuffer_face_normal};

@group(0) @binding(8) var pixel_irradiance: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let depth = textureLoad(gbuffer_depth, id.xy, 0);
    var total = vec3f(0.0);
    if depth > 0.0 {
        let position = frame_position(id.xy, depth);
        let view = frame_towards_viewer(position);
        total = direct_irradiance(position, gbuffer_normal(id.xy), gbuffer_face_normal(id.xy), view);
    }
    textureStore(pixel_irradiance, id.xy, vec4f(total, 1.0));
}
