// One layer of a finished frame as plain numbers, for files and debug views. The background is 0 in every layer but
// `indirect`, where it is the sky: so direct + indirect is the final picture everywhere.

import package::lib::brdf::{brdf_lambert};
import package::lib::camera::{camera_distance};
import package::lib::frame::{frame, frame_position, frame_ray};
import package::lib::sky::{sky_radiance};
import package::primary::gbuffer::{
    gbuffer_albedo, gbuffer_depth, gbuffer_emission, gbuffer_face_normal, gbuffer_motion, gbuffer_normal,
};
import package::view::headlight::{headlight};

@group(0) @binding(8) var direct_irradiance: texture_2d<f32>;
@group(0) @binding(9) var indirect_irradiance: texture_2d<f32>;
@group(0) @binding(10) var layer: texture_storage_2d<rgba32float, write>;

// Which layer: the order of views.LAYERS.
override LAYER: u32 = 0u;

const DIRECT = 0u;
const INDIRECT = 1u;
const IRRADIANCE = 2u;
const ALBEDO = 3u;
const NORMAL = 4u;
const FACE_NORMAL = 5u;
const POSITION = 6u;
const DEPTH = 7u;
const EMISSION = 8u;
const ROUGHNESS = 9u;
const MOTION = 10u;
const MESH = 11u;

fn layer_value(pixel: vec2u, depth: f32) -> vec3f {
    let albedo = textureLoad(gbuffer_albedo, pixel, 0);
    let emission = textureLoad(gbuffer_emission, pixel, 0);
    let indirect = textureLoad(indirect_irradiance, pixel, 0).rgb;
    switch LAYER {
        case DIRECT: { return brdf_lambert(albedo.rgb, textureLoad(direct_irradiance, pixel, 0).rgb); }
        case INDIRECT: { return brdf_lambert(albedo.rgb, indirect) + emission.rgb; }
        case IRRADIANCE: { return indirect; }
        case ALBEDO: { return albedo.rgb; }
        case NORMAL: { return gbuffer_normal(pixel); }
        case FACE_NORMAL: { return gbuffer_face_normal(pixel); }
        case POSITION: { return frame_position(pixel, depth); }
        case DEPTH: { return vec3f(camera_distance(depth, frame.depth_map, frame.orthographic)); }
        case EMISSION: { return emission.rgb; }
        case ROUGHNESS: { return vec3f(albedo.a, emission.a, 0.0); }
        case MOTION: { return textureLoad(gbuffer_motion, pixel, 0).xyz; }
        case MESH: { return albedo.rgb * headlight(gbuffer_normal(pixel), frame_ray(pixel).direction) + emission.rgb; }
        default: { return vec3f(0.0); }
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let depth = textureLoad(gbuffer_depth, id.xy, 0);
    var value = vec3f(0.0);
    if depth > 0.0 {
        value = layer_value(id.xy, depth);
    } else if LAYER == INDIRECT {
        value = sky_radiance(frame_ray(id.xy).direction);
    }
    textureStore(layer, id.xy, vec4f(value, select(0.0, 1.0, depth > 0.0)));
}
