// The textured triangles: what their vertices carry and what colour a point on them has.
// Imported by every pass that draws the scene.

import package::structs::{Instance, SurfaceMaterial};

@group(0) @binding(0) var<storage, read> instances: array<Instance>;
@group(0) @binding(1) var<uniform> material: SurfaceMaterial;
@group(0) @binding(2) var base_color_texture: texture_2d<f32>;
@group(0) @binding(3) var base_color_sampler: sampler;
@group(0) @binding(4) var emission_texture: texture_2d<f32>;
@group(0) @binding(5) var emission_sampler: sampler;
@group(0) @binding(6) var roughness_texture: texture_2d<f32>;
@group(0) @binding(7) var roughness_sampler: sampler;

// Texture coordinates are final: the set is chosen and KHR_texture_transform applied before upload.
struct Vertex {
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) base_color_uv: vec2f,
    @location(3) emission_uv: vec2f,
    @location(4) roughness_uv: vec2f,
    @location(5) color: vec4f,
    @builtin(instance_index) instance: u32,
}

fn surface_position(vertex: Vertex) -> vec3f {
    return (instances[vertex.instance].local_from_mesh * vec4f(vertex.position, 1.0)).xyz;
}

fn surface_previous_position(vertex: Vertex) -> vec3f {
    return (instances[vertex.instance].previous_local_from_mesh * vec4f(vertex.position, 1.0)).xyz;
}

// Not of unit length. The cofactor matrix carries normals through mirrors and uneven scales; its sign is
// mended when the normal is turned to the viewer.
fn surface_normal(vertex: Vertex) -> vec3f {
    let m = instances[vertex.instance].local_from_mesh;
    let cofactor = mat3x3f(
        cross(m[1].xyz, m[2].xyz), cross(m[2].xyz, m[0].xyz), cross(m[0].xyz, m[1].xyz),
    );
    let normal = cofactor * vertex.normal;
    return normal / max(max(abs(normal.x), abs(normal.y)), max(abs(normal.z), 1e-30));
}

fn surface_base_color(uv: vec2f, vertex_color: vec4f) -> vec4f {
    return textureSample(base_color_texture, base_color_sampler, uv) * vertex_color * material.base_color;
}

// Masked and blended surfaces are cut at a filtered alpha, everything else is opaque whatever its alpha.
fn surface_is_cut(alpha: f32) -> bool {
    return alpha < material.alpha_cutoff;
}

fn surface_emission(uv: vec2f) -> vec3f {
    return textureSample(emission_texture, emission_sampler, uv).rgb * material.emission;
}

// Roughness (x) and metalness (y): the green and blue channels, as glTF stores them.
fn surface_roughness(uv: vec2f) -> vec2f {
    return textureSample(roughness_texture, roughness_sampler, uv).gb * vec2f(material.roughness, material.metallic);
}

// Unit normal of a flat face from the screen derivatives of its position, turned to `towards`; `fallback` where
// the face is seen edge-on.
fn surface_face_normal(across: vec3f, down: vec3f, towards: vec3f, fallback: vec3f) -> vec3f {
    let largest = max(abs(across), abs(down));
    let scale = 1.0 / max(max(largest.x, largest.y), max(largest.z, 1e-30));
    let normal = cross(across * scale, down * scale);
    let squared = dot(normal, normal);
    let unit = select(fallback, normal * inverseSqrt(max(squared, 1e-30)), squared > 1e-20);
    return faceForward(unit, -towards, unit);
}

// Unit interpolated normal on the same side as the face's own.
fn surface_shading_normal(interpolated: vec3f, face_normal: vec3f) -> vec3f {
    let squared = dot(interpolated, interpolated);
    let unit = select(face_normal, interpolated * inverseSqrt(max(squared, 1e-30)), squared > 1e-20);
    return select(unit, -unit, dot(unit, face_normal) < 0.0);
}
