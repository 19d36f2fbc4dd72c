// The scene as one light sees it: depth for its shadows, and the reflective shadow map, what each texel reflects.
// The map holds radiance for a light of unit colour, so a light may change its strength without a new map, and a
// dim one loses no precision.

import package::structs::{Light};
import package::lib::brdf::{brdf_lambert};
import package::lib::half::{HALF_LARGEST};
import package::lib::normal::{normal_pack};
import package::lib::punctual::{punctual_attenuation, punctual_direction};
import package::primary::surface::{
    Vertex, surface_base_color, surface_face_normal, surface_is_cut, surface_normal, surface_position,
    surface_shading_normal,
};

@group(0) @binding(8) var<uniform> light: Light;

struct Varyings {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) base_color_uv: vec2f,
    @location(3) color: vec4f,
}

struct Texels {
    @location(0) normal: u32,
    @location(1) radiance: vec4f,
}

@vertex
fn vertex_main(vertex: Vertex) -> Varyings {
    let position = surface_position(vertex);
    var varyings: Varyings;
    varyings.clip = light.clip_from_local * vec4f(position, 1.0);
    varyings.position = position;
    varyings.normal = surface_normal(vertex);
    varyings.base_color_uv = vertex.base_color_uv;
    varyings.color = vertex.color;
    return varyings;
}

@fragment
fn fragment_main(varyings: Varyings) -> Texels {
    let towards = punctual_direction(light, varyings.position);
    let interpolated = surface_shading_normal(varyings.normal, towards);
    let face_normal = surface_face_normal(dpdx(varyings.position), dpdy(varyings.position), towards, interpolated);
    let base_color = surface_base_color(varyings.base_color_uv, varyings.color);
    if surface_is_cut(base_color.a) {
        discard;
    }
    let normal = surface_shading_normal(varyings.normal, face_normal);
    let irradiance = max(dot(normal, towards), 0.0) * punctual_attenuation(light, varyings.position);
    let radiance = min(brdf_lambert(base_color.rgb, vec3f(irradiance)), vec3f(HALF_LARGEST));
    return Texels(normal_pack(face_normal), vec4f(radiance, 1.0));
}
