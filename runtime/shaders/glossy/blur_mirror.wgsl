// One level of the blurred mirror from the one below (McGuire 2019, part 3, "Glossy GI", step 2): bilateral, so that
// edges of what reflects stay; where nothing reflects, the surroundings flow in, so that filtering never meets black.

import package::lib::frame::{frame, frame_position};
import package::primary::gbuffer::{gbuffer_depth, gbuffer_normal};

@group(0) @binding(8) var sharper: texture_2d<f32>;
@group(0) @binding(9) var blurred: texture_storage_2d<rgba16float, write>;

const NO_MIRROR: f32 = -1.0;

// Standard deviation of the filter, in texels of the sharper level.
const DEVIATION: f32 = 1.0;

// How far, as a share of the distance to the viewer, a tap's surface may lie off the plane of the texel's own, and the
// power of the cosine between their normals.
const PLANE_SHARE: f32 = 0.02;
const NORMAL_POWER: f32 = 16.0;

// Weight of taps across an edge: it counts where no other tap does.
const ACROSS: f32 = 1e-4;

struct Guide {
    position: vec3f,
    normal: vec3f,
    is_surface: bool,
}

// The surface seen at a place of the picture, in shares.
fn guide(uv: vec2f) -> Guide {
    let pixel = min(vec2u(uv * vec2f(frame.size)), frame.size - 1u);
    let depth = textureLoad(gbuffer_depth, pixel, 0);
    if depth == 0.0 {
        return Guide(vec3f(0.0), vec3f(0.0), false);
    }
    return Guide(frame_position(pixel, depth), gbuffer_normal(pixel), true);
}

fn likeness(own: Guide, other: Guide) -> f32 {
    if !own.is_surface || !other.is_surface {
        return ACROSS;
    }
    let away = distance(own.position, frame.local_from_view[3].xyz);
    let off_plane = abs(dot(other.position - own.position, own.normal)) / (PLANE_SHARE * away + 1e-20);
    return max(exp(-off_plane) * pow(max(dot(own.normal, other.normal), 0.0), NORMAL_POWER), ACROSS);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(blurred);
    if any(id.xy >= size) {
        return;
    }
    let source = vec2i(textureDimensions(sharper));
    let uv = (vec2f(id.xy) + 0.5) / vec2f(size);
    let place = uv * vec2f(source);
    let own = guide(uv);
    var total = vec4f(0.0);
    var weights = 0.0;
    for (var y = -2; y < 2; y++) {
        for (var x = -2; x < 2; x++) {
            let texel = clamp(vec2i(round(place)) + vec2i(x, y), vec2i(0), source - 1);
            let value = textureLoad(sharper, texel, 0);
            if value.w == NO_MIRROR {
                continue;
            }
            let centre = vec2f(texel) + 0.5;
            let offset = (centre - place) / DEVIATION;
            let weight = exp(-0.5 * dot(offset, offset)) * likeness(own, guide(centre / vec2f(source)));
            total += weight * value;
            weights += weight;
        }
    }
    textureStore(blurred, id.xy, select(vec4f(0.0, 0.0, 0.0, NO_MIRROR), total / max(weights, 1e-20), weights > 0.0));
}
