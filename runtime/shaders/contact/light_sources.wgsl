// What every texel sends to its surroundings: the radiance of its surface as the last frame composed it, found by motion
// vectors. Only the contact light is a frame old: direct light, emission and probes are this frame's, so that nothing
// lags behind a lamp. Surfaces take all light for diffuse: reflections go to the viewer alone.

import package::contact::compose::{contact_compose};
import package::contact::info::{contact, contact_distance, contact_pixel, contact_place};
import package::lib::brdf::{brdf_lambert};
import package::lib::frame::{frame};
import package::lib::half::{HALF_BOUND};
import package::primary::gbuffer::{gbuffer_albedo, gbuffer_depth, gbuffer_emission, gbuffer_motion, gbuffer_normal};
import package::primary::previous::{previous_depth, previous_normal};

@group(0) @binding(9) var direct_irradiance: texture_2d<f32>;
@group(0) @binding(10) var probe_irradiance: texture_2d<f32>;
@group(0) @binding(11) var contact_history: texture_2d<f32>;

// Frames averaged, a frame ago.
@group(0) @binding(12) var contact_past_frames: texture_2d<f32>;

// Radiance, and in w how many frames of history the texel has.
@group(0) @binding(13) var contact_sources: texture_storage_2d<rgba16float, write>;

// The history, moved to where its surfaces are now.
@group(0) @binding(14) var contact_moved: texture_storage_2d<rgba32float, write>;

// How far apart, as a share of the distance, two surfaces may be and still be taken for the same, and the smallest cosine
// between their normals. An object that comes or goes is found by its motion, as far as it turns by less than that.
const SAME_DISTANCE: f32 = 0.05;
const SAME_NORMAL: f32 = 0.8;

struct Past {
    gathered: vec4f,
    frames: f32,
}

fn is_same(texel: vec2u, expected: f32, normal: vec3f) -> bool {
    let pixel = contact_pixel(texel);
    let depth = textureLoad(previous_depth, pixel, 0);
    if depth == 0.0 || expected <= 0.0 {
        return false;
    }
    let wanted = contact_distance(expected);
    return abs(contact_distance(depth) - wanted) <= SAME_DISTANCE * abs(wanted)
        && dot(previous_normal(pixel), normal) >= SAME_NORMAL;
}

// The history of the surface at a pixel: bilinear among the texels that showed it; no frames where none did.
fn past_of(pixel: vec2u) -> Past {
    let motion = textureLoad(gbuffer_motion, pixel, 0).xyz;
    let normal = gbuffer_normal(pixel);
    let place = contact_place(vec2f(pixel) + 0.5 + motion.xy * vec2f(frame.size));
    let corner = vec2i(floor(place));
    let share = fract(place);
    var gathered = vec4f(0.0);
    var frames = 0.0;
    var weights = 0.0;
    for (var i = 0; i < 4; i++) {
        let offset = vec2i(i & 1, i >> 1);
        let texel = corner + offset;
        if any(texel < vec2i(0)) || any(texel >= vec2i(contact.size)) {
            continue;
        }
        let sides = select(1.0 - share, share, offset == vec2i(1));
        let weight = sides.x * sides.y;
        if weight > 0.0 && is_same(vec2u(texel), motion.z, normal) {
            gathered += weight * textureLoad(contact_history, texel, 0);
            frames += weight * textureLoad(contact_past_frames, texel, 0).x;
            weights += weight;
        }
    }
    if weights < 1e-3 {
        return Past(vec4f(0.0, 0.0, 0.0, 1.0), 0.0);
    }
    return Past(gathered / weights, frames / weights);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= contact.size) {
        return;
    }
    let pixel = contact_pixel(id.xy);
    if textureLoad(gbuffer_depth, pixel, 0) == 0.0 {
        textureStore(contact_sources, id.xy, vec4f(0.0));
        textureStore(contact_moved, id.xy, vec4f(0.0, 0.0, 0.0, 1.0));
        return;
    }
    let past = past_of(pixel);
    let indirect = contact_compose(past.gathered, textureLoad(probe_irradiance, pixel, 0).rgb);
    let direct = textureLoad(direct_irradiance, pixel, 0).rgb;
    let reflected = brdf_lambert(textureLoad(gbuffer_albedo, pixel, 0).rgb, direct + indirect);
    let radiance = reflected + textureLoad(gbuffer_emission, pixel, 0).rgb;
    textureStore(contact_sources, id.xy, vec4f(min(radiance, vec3f(HALF_BOUND)), past.frames));
    textureStore(contact_moved, id.xy, past.gathered);
}
