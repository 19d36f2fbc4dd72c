// Direct light with shadows. Suns and the first spots have a tile in the shadow atlas, which doubles as a
// reflective shadow map (Dachsbacher and Stamminger 2005); every other light is shadowed by tracing the primitives.

import package::structs::{Light};
import package::lib::brdf::{brdf_lambert};
import package::lib::camera::{camera_distance, camera_view_position};
import package::lib::light_list::{lighting, lights};
import package::lib::march::{trace_start_seen, trace_visibility};
import package::lib::normal::{normal_unpack};
import package::lib::punctual::{PUNCTUAL_SUN, punctual_attenuation, punctual_direction, punctual_distance};

@group(3) @binding(5) var shadow_depth: texture_depth_2d;
@group(3) @binding(6) var shadow_sampler: sampler_comparison;
@group(3) @binding(7) var rsm_normal: texture_2d<u32>;
@group(3) @binding(8) var rsm_radiance: texture_2d<f32>;

// How many samples of reflective shadow maps an invocation asked for, how many of them were refused, and of how many of
// those a traced shadow found the light after all.
var<private> lights_rsm_asked: u32;
var<private> lights_rsm_refused: u32;
var<private> lights_rsm_missed: u32;

// Half-width of the filter below in texels: taps at -1, 0, 1, each bilinear.
const LIGHTS_FILTER_RADIUS = 2.0;

// How far past a surface, in texels, the shadow test starts even where the light falls straight on it.
const LIGHTS_SMALLEST_OFFSET = 0.25;

// Metres that a texel of the light's tile covers at a position.
fn lights_texel_size(light: Light, position: vec3f) -> f32 {
    return light.texel_size * select(length(light.position - position), 1.0, light.kind == PUNCTUAL_SUN);
}

// Texel coordinates in the atlas (xy) and reversed depth (z) of a local position; w = 0 outside of the tile.
fn lights_project(light: Light, position: vec3f) -> vec4f {
    let clip = light.clip_from_local * vec4f(position, 1.0);
    let ndc = clip.xyz / select(1.0, clip.w, clip.w > 0.0);
    let inside = clip.w > 0.0 && all(abs(ndc.xy) < vec2f(1.0));
    let texel = light.tile_corner + (ndc.xy * vec2f(0.5, -0.5) + 0.5) * light.tile_size;
    return vec4f(texel, ndc.z, select(0.0, 1.0, inside));
}

// Share of the light's shadow-map texels around a position that see it. The position moves along the geometric
// normal as far as the filter's footprint reaches below the surface's plane, so that no surface shadows itself.
fn lights_mapped_visibility(light: Light, position: vec3f, normal: vec3f) -> f32 {
    let cosine = clamp(dot(normal, punctual_direction(light, position)), 0.0, 1.0);
    let texels = LIGHTS_SMALLEST_OFFSET + LIGHTS_FILTER_RADIUS * sqrt(1.0 - cosine * cosine);
    let start = position + normal * (texels * lights_texel_size(light, position));
    let place = lights_project(light, start);
    if place.w == 0.0 {
        return 1.0;
    }
    let lowest = light.tile_corner + 0.5;
    let highest = light.tile_corner + light.tile_size - 0.5;
    var seen = 0.0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let texel = clamp(place.xy + vec2f(f32(x), f32(y)), lowest, highest);
            let uv = texel / lighting.atlas_size;
            seen += textureSampleCompareLevel(shadow_depth, shadow_sampler, uv, place.z);
        }
    }
    return seen / 9.0;
}

// Share of a light that reaches a surface point: by its shadow map when it has one, else through the primitives.
fn lights_visibility(light: Light, position: vec3f, normal: vec3f, view: vec3f) -> f32 {
    if light.has_tile != 0u {
        return lights_mapped_visibility(light, position, normal);
    }
    // A point of the mesh may lie inside a primitive of the fit: start where it is free.
    let start = trace_start_seen(position, normal, view);
    return start.w * lights_traced_visibility(light, start.xyz);
}

fn lights_traced_visibility(light: Light, position: vec3f) -> f32 {
    return trace_visibility(position, punctual_direction(light, position), punctual_distance(light, position));
}

// Direct irradiance (W/m2) at a point of the mesh. Both normals face the viewer, who is in the direction `view`.
fn direct_irradiance(position: vec3f, normal: vec3f, geometric_normal: vec3f, view: vec3f) -> vec3f {
    var total = vec3f(0.0);
    for (var i = 0u; i < lighting.count; i++) {
        let light = lights[i];
        let towards = punctual_direction(light, position);
        let cosine = dot(normal, towards);
        let strength = cosine * punctual_attenuation(light, position);
        if strength <= 0.0 || dot(geometric_normal, towards) <= 0.0 {
            continue;
        }
        total += light.color * (strength * lights_visibility(light, position, geometric_normal, view));
    }
    return total;
}

// What the reflective shadow map holds for a hit: reflected radiance (W/m2/sr) and w = 1, or zeros where it does not
// see the hit. A sample counts only if its normal agrees and its plane passes within half the local thickness:
// a wider tolerance would read the sunlit face of a thin wall from its dark side.
fn lights_rsm_radiance(light: Light, position: vec3f, normal: vec3f, half_thickness: f32) -> vec4f {
    let place = lights_project(light, position);
    if place.w == 0.0 {
        return vec4f(0.0);
    }
    let texel = vec2i(min(place.xy, light.tile_corner + light.tile_size - 1.0));
    let depth = textureLoad(shadow_depth, texel, 0);
    if depth == 0.0 {
        return vec4f(0.0);
    }
    let seen_normal = normal_unpack(textureLoad(rsm_normal, texel, 0).r);
    let seen_position = lights_texel_position(light, texel, depth);
    let gap = abs(dot(position - seen_position, seen_normal));
    let tolerance = min(lighting.rsm_tolerance, half_thickness);
    if dot(normal, seen_normal) <= lighting.rsm_normal_agreement || gap > tolerance {
        return vec4f(0.0);
    }
    return vec4f(textureLoad(rsm_radiance, texel, 0).rgb * light.color, 1.0);
}

// Local position of a shadow-map texel's centre.
fn lights_texel_position(light: Light, texel: vec2i, depth: f32) -> vec3f {
    let share = (vec2f(texel) + 0.5 - light.tile_corner) / light.tile_size;
    let ndc = share * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
    let orthographic = select(0u, 1u, light.kind == PUNCTUAL_SUN);
    let distance = camera_distance(depth, light.depth_map, orthographic);
    let view = camera_view_position(ndc, distance, light.extent, orthographic);
    return (light.local_from_light * vec4f(view, 1.0)).xyz;
}

// Direct radiance that a hit on a primitive reflects, W/m2/sr: from the reflective shadow maps where they see the
// hit, else with a traced shadow. half_thickness: half the hit primitive's smallest extent, metres.
fn direct_radiance_at_hit(position: vec3f, normal: vec3f, albedo: vec3f, half_thickness: f32) -> vec3f {
    var total = vec3f(0.0);
    for (var i = 0u; i < lighting.count; i++) {
        let light = lights[i];
        let cosine = dot(normal, punctual_direction(light, position));
        let strength = cosine * punctual_attenuation(light, position);
        if strength <= 0.0 {
            continue;
        }
        if light.has_tile != 0u {
            let reflected = lights_rsm_radiance(light, position, normal, half_thickness);
            lights_rsm_asked += 1u;
            if reflected.w > 0.0 {
                total += reflected.rgb;
                continue;
            }
            lights_rsm_refused += 1u;
        }
        let visible = lights_traced_visibility(light, position);
        lights_rsm_missed += select(0u, 1u, light.has_tile != 0u && visible > 0.0);
        total += brdf_lambert(albedo, light.color * (strength * visible));
    }
    return total;
}
