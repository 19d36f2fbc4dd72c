// What a pixel makes of the samples that answer for it, and of its light in the last frame.

import package::lib::camera::{camera_distance, camera_ndc, camera_view_position};
import package::lib::frame::{frame};
import package::primary::gbuffer::{gbuffer_motion};
import package::primary::previous::{previous_depth, previous_normal};
import package::shading::pixels::{PixelSurface, shading, surfaces_agree};

// Irradiance, and the weight of its running mean in samples of the pixel's own.
@group(0) @binding(13) var history: texture_2d<f32>;

// The nearer to a pixel's centre history falls, pixels, the surer it is that exact place.
const SNAP: f32 = 0.01;

struct Neighbours {
    // Sum of weighted samples, and of weights.
    total: vec4f,
    lowest: vec3f,
    highest: vec3f,
    // What was sampled at the pixel itself.
    own: vec3f,
    has_own: bool,
}

fn no_neighbours() -> Neighbours {
    return Neighbours(vec4f(0.0), vec3f(3.0e38), vec3f(0.0), vec3f(0.0), false);
}

// The weight of a sample `offset` pixels away whose normal is at this cosine to the pixel's.
fn sample_weight(offset: vec2f, cosine: f32) -> f32 {
    let likeness = pow(max(cosine, 0.0), shading.normal_exponent);
    return exp(-0.5 * dot(offset, offset) / (shading.filter_width * shading.filter_width)) * likeness;
}

fn with_sample(found: Neighbours, light: vec3f, weight: f32) -> Neighbours {
    var more = found;
    more.total += weight * vec4f(light, 1.0);
    more.lowest = min(more.lowest, light);
    more.highest = max(more.highest, light);
    return more;
}

// Local position, in the last frame, of a place in its picture.
fn previous_position(place: vec2f, depth: f32) -> vec3f {
    let ndc = camera_ndc(place, vec2f(frame.size));
    let distance = camera_distance(depth, frame.previous_depth_map, frame.orthographic);
    let view = camera_view_position(ndc, distance, frame.previous_extent, frame.orthographic);
    return (frame.previous_local_from_view * vec4f(view, 1.0)).xyz;
}

// The last frame's irradiance of the point that a pixel shows, and its weight: 0 where it was hidden or out of the
// picture.
fn reproject(pixel: vec2u, normal: vec3f) -> vec4f {
    let motion = textureLoad(gbuffer_motion, pixel, 0);
    if motion.z <= 0.0 {
        return vec4f(0.0);
    }
    var place = vec2f(pixel) + motion.xy * vec2f(frame.size);
    place = select(place, round(place), abs(place - round(place)) < vec2f(SNAP));
    let point = PixelSurface(previous_position(place + 0.5, motion.z), normal);
    let corner = floor(place);
    let share = place - corner;
    var total = vec4f(0.0);
    var found = 0.0;
    for (var i = 0u; i < 4u; i++) {
        let offset = vec2f(f32(i & 1u), f32(i >> 1u));
        let tap = corner + offset;
        let sides = select(1.0 - share, share, offset == vec2f(1.0));
        let weight = sides.x * sides.y;
        if weight == 0.0 || any(tap < vec2f(0.0)) || any(tap >= vec2f(frame.size)) {
            continue;
        }
        let depth = textureLoad(previous_depth, vec2u(tap), 0);
        if depth <= 0.0 {
            continue;
        }
        let shown = PixelSurface(previous_position(tap + 0.5, depth), previous_normal(vec2u(tap)));
        if surfaces_agree(point, shown) {
            let light = textureLoad(history, vec2u(tap), 0);
            total += weight * vec4f(light.rgb, light.w);
            found += weight;
        }
    }
    // A point seen by less than a quarter of its taps has come into view.
    if found < 0.25 {
        return vec4f(0.0);
    }
    return total / found;
}

// The running mean of a pixel's light, and its weight: history clipped to the range of the samples, and what they say.
fn blend_history(pixel: vec2u, normal: vec3f, found: Neighbours) -> vec4f {
    let room = shading.clip_margin * (found.highest - found.lowest);
    let past = reproject(pixel, normal);
    let clipped = clamp(past.rgb, max(found.lowest - room, vec3f(0.0)), found.highest + room);
    let light = select(found.total.rgb / found.total.w, found.own, found.has_own);
    let weight = select(shading.guess_weight, 1.0, found.has_own);
    let all = past.w + weight;
    return vec4f((past.w * clipped + weight * light) / all, min(all, shading.history_weight));
}
