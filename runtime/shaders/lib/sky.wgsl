// Radiance of the sky: constant, a gradient, or an equirectangular picture. Directions are of unit length.
// Twin: runtime/twins/sky.py

import package::structs::{SkyModel};

@group(3) @binding(1) var<uniform> sky: SkyModel;
@group(3) @binding(2) var sky_texture: texture_2d<f32>;

const SKY_PI = 3.14159265358979;

// Equirectangular coordinates in [0, 1]: u = atan2(x, -z) / 2 pi mod 1, v = acos(y) / pi (0 at the zenith), by an
// arc tangent because arc cosines on GPUs are only good to 4 digits.
fn sky_uv(direction: vec3f) -> vec2f {
    let turns = atan2(direction.x, -direction.z) / (2.0 * SKY_PI);
    return vec2f(fract(turns), atan2(length(direction.xz), direction.y) / SKY_PI);
}

// base + slope (axis . direction), never negative.
fn sky_gradient(base: vec3f, slope: vec3f, axis: vec3f, direction: vec3f) -> vec3f {
    return max(base + slope * dot(axis, direction), vec3f(0.0));
}

// Level of the picture's pyramid whose texels at the horizon cover the given solid angle (steradians).
fn sky_level(solid_angle: f32, size: vec2f) -> f32 {
    let texel = 2.0 * SKY_PI * SKY_PI / (size.x * size.y);
    return max(0.5 * log2(max(solid_angle, 1e-12) / texel), 0.0);
}

// Bilinear by hand: float32 textures need not be filterable, and columns wrap where rows clamp.
fn sky_texel_blend(uv: vec2f, level: u32) -> vec3f {
    let size = vec2i(textureDimensions(sky_texture, level));
    let place = uv * vec2f(size) - 0.5;
    let corner = vec2i(floor(place));
    let blend = place - floor(place);
    let columns = (vec2i(corner.x, corner.x + 1) + size.x) % size.x;
    let rows = clamp(vec2i(corner.y, corner.y + 1), vec2i(0), vec2i(size.y - 1));
    let top = mix(
        textureLoad(sky_texture, vec2i(columns.x, rows.x), level).rgb,
        textureLoad(sky_texture, vec2i(columns.y, rows.x), level).rgb,
        blend.x,
    );
    let bottom = mix(
        textureLoad(sky_texture, vec2i(columns.x, rows.y), level).rgb,
        textureLoad(sky_texture, vec2i(columns.y, rows.y), level).rgb,
        blend.x,
    );
    return mix(top, bottom, blend.y);
}

// Radiance seen in a direction, W/m2/sr.
fn sky_radiance(direction: vec3f) -> vec3f {
    if sky.has_picture != 0u {
        return sky_texel_blend(sky_uv(direction), 0u);
    }
    return sky_gradient(sky.base, sky.slope, sky.axis, direction);
}

// Mean radiance over about `solid_angle` steradians around a direction: what one of few rays should take.
fn sky_radiance_within(direction: vec3f, solid_angle: f32) -> vec3f {
    if sky.has_picture == 0u {
        return sky_gradient(sky.base, sky.slope, sky.axis, direction);
    }
    let level = round(sky_level(solid_angle, vec2f(textureDimensions(sky_texture))));
    let last = textureNumLevels(sky_texture) - 1u;
    return sky_texel_blend(sky_uv(direction), min(u32(level), last));
}
