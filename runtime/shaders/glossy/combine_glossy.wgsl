// Radiance of every pixel with its reflections (McGuire 2019, part 3, "Glossy GI", step 3): the diffuse part under direct
// and indirect light, and the blurred mirror at the level that the roughness and the reflected distance ask for.

import package::glossy::environment::{environment_share};
import package::lib::brdf::{brdf_lambert};
import package::lib::frame::{frame, frame_position, frame_ray, frame_towards_viewer};
import package::lib::sky::{sky_radiance};
import package::primary::gbuffer::{gbuffer_albedo, gbuffer_depth, gbuffer_emission, gbuffer_normal};
import package::technique::lookup::{gi_radiance};

@group(0) @binding(8) var direct_irradiance: texture_2d<f32>;
@group(0) @binding(9) var indirect_irradiance: texture_2d<f32>;
@group(0) @binding(10) var mirror_levels: texture_2d<f32>;
@group(0) @binding(11) var mirror_sampler: sampler;
@group(0) @binding(12) var radiance: texture_storage_2d<rgba32float, write>;

const NO_MIRROR: f32 = -1.0;

// Reflectance of glass, wood, stone: glTF's for all that is no metal.
const DIELECTRIC: f32 = 0.04;

// Where a texel has no reflection of its own, this level has that of its surroundings.
const FILLED_LEVEL: f32 = 3.0;

// Levels left unused at the chain's end: a lobe wider than a quarter of the picture holds what reflects elsewhere, and the
// probes know better.
const UNUSED_LEVELS: f32 = 2.0;

// The level whose texels are as wide as the lobe: half of a GGX lobe's light leaves within twice the angle whose
// tangent is the roughness squared.
fn mirror_level(roughness: f32, depth: f32) -> f32 {
    let slope = 2.0 * roughness * roughness;
    let texel = 4.0 * frame.extent.y / f32(frame.size.y);
    return log2(max(depth * slope / texel, 1.0));
}

fn glossy_radiance(pixel: vec2u, position: vec3f, normal: vec3f, towards_viewer: vec3f, roughness: f32) -> vec3f {
    let last = max(f32(textureNumLevels(mirror_levels) - 1u) - UNUSED_LEVELS, 0.0);
    let uv = (0.5 * vec2f(pixel) + 0.5) / vec2f(textureDimensions(mirror_levels));
    var depth = textureLoad(mirror_levels, min(pixel / 2u, textureDimensions(mirror_levels) - 1u), 0).w;
    let least = select(0.0, min(FILLED_LEVEL, last), depth == NO_MIRROR);
    // What the whole lobe meets, and not its middle alone, says how wide it is.
    let first = clamp(mirror_level(roughness, depth), least, last);
    depth = textureSampleLevel(mirror_levels, mirror_sampler, uv, first).w;
    let wanted = max(mirror_level(roughness, max(depth, 0.0)), least);
    let blurred = textureSampleLevel(mirror_levels, mirror_sampler, uv, min(wanted, last)).rgb;
    let beyond = clamp(wanted - last, 0.0, 1.0);
    if beyond == 0.0 {
        return blurred;
    }
    // A wide lobe leans towards the normal, because half of it would be below the surface.
    let middle = normalize(mix(reflect(-towards_viewer, normal), normal, roughness));
    return mix(blurred, gi_radiance(position, middle), beyond);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let depth = textureLoad(gbuffer_depth, id.xy, 0);
    if depth == 0.0 {
        textureStore(radiance, id.xy, vec4f(sky_radiance(frame_ray(id.xy).direction), 1.0));
        return;
    }
    let position = frame_position(id.xy, depth);
    let base = textureLoad(gbuffer_albedo, id.xy, 0);
    let emission = textureLoad(gbuffer_emission, id.xy, 0);
    let metalness = emission.a;
    let normal = gbuffer_normal(id.xy);
    let towards_viewer = frame_towards_viewer(position);
    let cosine = max(dot(normal, towards_viewer), 0.0);
    let share = environment_share(mix(vec3f(DIELECTRIC), base.rgb, metalness), base.a, cosine);
    let beneath = 1.0 - environment_share(vec3f(DIELECTRIC), base.a, cosine).r;
    let direct = textureLoad(direct_irradiance, id.xy, 0).rgb;
    let indirect = textureLoad(indirect_irradiance, id.xy, 0).rgb;
    let diffuse = brdf_lambert(base.rgb * ((1.0 - metalness) * beneath), direct + indirect);
    let reflected = glossy_radiance(id.xy, position, normal, towards_viewer, base.a);
    let total = diffuse + share * reflected + emission.rgb;
    textureStore(radiance, id.xy, vec4f(total, 1.0));
}
