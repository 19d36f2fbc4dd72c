// The scene's triangles into the G-buffer. Every face has two sides: its normals are turned to the viewer.

import package::lib::frame::{frame, frame_towards_viewer};
import package::lib::half::{HALF_LARGEST};
import package::lib::normal::{normal_pack};
import package::primary::surface::{
    Vertex, surface_base_color, surface_emission, surface_face_normal, surface_is_cut, surface_normal,
    surface_position, surface_previous_position, surface_roughness, surface_shading_normal,
};

struct Varyings {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) base_color_uv: vec2f,
    @location(3) emission_uv: vec2f,
    @location(4) roughness_uv: vec2f,
    @location(5) color: vec4f,
    @location(6) previous_clip: vec4f,
}

struct Texels {
    @location(0) normals: vec2u,
    @location(1) albedo: vec4f,
    @location(2) emission: vec4f,
    @location(3) motion: vec4f,
}

@vertex
fn vertex_main(vertex: Vertex) -> Varyings {
    let position = surface_position(vertex);
    var varyings: Varyings;
    varyings.clip = frame.clip_from_local * vec4f(position, 1.0);
    varyings.position = position;
    varyings.normal = surface_normal(vertex);
    varyings.base_color_uv = vertex.base_color_uv;
    varyings.emission_uv = vertex.emission_uv;
    varyings.roughness_uv = vertex.roughness_uv;
    varyings.color = vertex.color;
    varyings.previous_clip = frame.previous_clip_from_local * vec4f(surface_previous_position(vertex), 1.0);
    return varyings;
}

// Where the point was a frame ago minus where it is, in shares of the picture, v downward, and the depth that it had
// there: 0 where it was behind the camera.
fn motion_of(clip: vec4f, previous_clip: vec4f) -> vec4f {
    let ndc = previous_clip.xyz / max(previous_clip.w, 1e-6);
    let motion = ndc.xy * vec2f(0.5, -0.5) + 0.5 - clip.xy / vec2f(frame.size);
    return vec4f(motion, select(0.0, ndc.z, previous_clip.w > 0.0), 0.0);
}

@fragment
fn fragment_main(varyings: Varyings) -> Texels {
    let towards = frame_towards_viewer(varyings.position);
    let interpolated = surface_shading_normal(varyings.normal, towards);
    let face_normal = surface_face_normal(dpdx(varyings.position), dpdy(varyings.position), towards, interpolated);
    let base_color = surface_base_color(varyings.base_color_uv, varyings.color);
    let emission = surface_emission(varyings.emission_uv);
    let roughness = surface_roughness(varyings.roughness_uv);
    if surface_is_cut(base_color.a) {
        discard;
    }
    let normal = surface_shading_normal(varyings.normal, face_normal);
    var texels: Texels;
    texels.normals = vec2u(normal_pack(normal), normal_pack(face_normal));
    texels.albedo = vec4f(base_color.rgb, roughness.x);
    texels.emission = vec4f(min(emission, vec3f(HALF_LARGEST)), roughness.y);
    texels.motion = motion_of(varyings.clip, varyings.previous_clip);
    return texels;
}
