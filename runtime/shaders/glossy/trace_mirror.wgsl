// Mirror rays at half the resolution (McGuire 2019, part 3, "Glossy GI", step 1): every surface as if it were perfectly
// smooth. What they meet is lit by the probes and by rays to the lamps: in a mirror, the texels of a shadow map would show.

import package::lib::brdf::{brdf_lambert};
import package::lib::frame::{frame, frame_position, frame_towards_viewer};
import package::lib::half::{HALF_BOUND};
import package::lib::sky::{sky_radiance};
import package::paths::lamps::{lamps_irradiance};
import package::primary::gbuffer::{gbuffer_depth, gbuffer_normal};
import package::technique::lookup::{gi_irradiance};
import package::tracer::sights::{sight_along, sight_start};

// Radiance, and in w how far behind the surface its mirror image is seen: reflected over whole distance, or for
// an orthographic camera the reflected distance, metres; NO_MIRROR where nothing is reflected.
@group(0) @binding(8) var mirror: texture_storage_2d<rgba16float, write>;

const NO_MIRROR: f32 = -1.0;

fn mirror_depth(position: vec3f, reflected: f32) -> f32 {
    let whole = reflected + distance(position, frame.local_from_view[3].xyz);
    return min(reflected / select(whole, 1.0, frame.orthographic != 0u), HALF_BOUND);
}

fn mirrored(pixel: vec2u) -> vec4f {
    let depth = textureLoad(gbuffer_depth, pixel, 0);
    if depth == 0.0 {
        return vec4f(0.0, 0.0, 0.0, NO_MIRROR);
    }
    let position = frame_position(pixel, depth);
    let normal = gbuffer_normal(pixel);
    let start = sight_start(position, normal);
    if start.w == 0.0 {
        return vec4f(0.0, 0.0, 0.0, NO_MIRROR);
    }
    let direction = reflect(-frame_towards_viewer(position), normal);
    let seen = sight_along(start.xyz, direction, 1e30);
    if !seen.is_hit {
        return vec4f(min(sky_radiance(direction), vec3f(HALF_BOUND)), mirror_depth(position, seen.t));
    }
    let direct = lamps_irradiance(seen.position, seen.normal);
    let indirect = gi_irradiance(seen.position, seen.normal, -direction);
    let radiance = seen.emission + brdf_lambert(seen.albedo, direct + indirect);
    return vec4f(min(radiance, vec3f(HALF_BOUND)), mirror_depth(position, seen.t));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= textureDimensions(mirror)) {
        return;
    }
    textureStore(mirror, id.xy, mirrored(min(2u * id.xy, frame.size - 1u)));
}
