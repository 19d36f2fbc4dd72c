// Scene radiance to display values: exposure, tone curve, sRGB.

import package::structs::{Display};
import package::lib::color::{color_srgb_from_linear, color_tone};

@group(0) @binding(0) var radiance: texture_2d<f32>;
@group(0) @binding(1) var<uniform> display: Display;
@group(0) @binding(2) var picture: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= textureDimensions(picture)) {
        return;
    }
    let toned = color_tone(textureLoad(radiance, id.xy, 0).rgb, display.exposure, display.tone_curve);
    textureStore(picture, id.xy, vec4f(color_srgb_from_linear(toned), 1.0));
}
