// Irradiance of every pixel from the probes' and the contact light of the texels around it, before albedo. Texels on the
// same surface count; where there is none, the nearest does.

import package::contact::compose::{contact_compose};
import package::contact::info::{contact, contact_pixel, contact_place};
import package::contact::likeness::{guide_of, likeness};
import package::lib::frame::{frame};
import package::primary::gbuffer::{gbuffer_depth};

@group(0) @binding(9) var probe_irradiance: texture_2d<f32>;
@group(0) @binding(10) var contact_denoised: texture_2d<f32>;
@group(0) @binding(11) var indirect_irradiance: texture_storage_2d<rgba32float, write>;

// Weight of texels on other surfaces: it counts where no other texel does.
const ACROSS: f32 = 1e-4;

fn upsampled(pixel: vec2u) -> vec4f {
    if contact.scale == 1u {
        return textureLoad(contact_denoised, pixel, 0);
    }
    let own = guide_of(pixel);
    let place = contact_place(vec2f(pixel) + 0.5);
    let corner = vec2u(place);
    let share = fract(place);
    var total = vec4f(0.0);
    var weights = 0.0;
    for (var i = 0u; i < 4u; i++) {
        let offset = vec2u(i & 1u, i >> 1u);
        let texel = min(corner + offset, contact.size - 1u);
        let sides = select(1.0 - share, share, offset == vec2u(1u));
        let weight = sides.x * sides.y * max(likeness(own, guide_of(contact_pixel(texel))), ACROSS);
        total += weight * textureLoad(contact_denoised, texel, 0);
        weights += weight;
    }
    return total / weights;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    var total = vec3f(0.0);
    if textureLoad(gbuffer_depth, id.xy, 0) > 0.0 {
        total = contact_compose(upsampled(id.xy), textureLoad(probe_irradiance, id.xy, 0).rgb);
    }
    textureStore(indirect_irradiance, id.xy, vec4f(total, 1.0));
}
