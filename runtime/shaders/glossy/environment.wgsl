// What a GGX surface reflects of surroundings that are equally bright in all directions.

// Share of light that a surface of reflectance `f0` sends on (Karis 2014, "Physically based shading on mobile"), with
// the light that bounces between microfacets (Turquin 2019): at f0 = 1 nothing is lost.
fn environment_share(f0: vec3f, roughness: f32, cosine: f32) -> vec3f {
    let r = roughness * vec4f(-1.0, -0.0275, -0.572, 0.022) + vec4f(1.0, 0.0425, 1.04, -0.04);
    let a = min(r.x * r.x, exp2(-9.28 * cosine)) * r.x + r.y;
    let scale = clamp(-1.04 * a + r.z, 0.0, 1.0);
    let bias = clamp(1.04 * a + r.w, 0.0, 1.0);
    let single = f0 * scale + bias;
    return clamp(single * (1.0 + f0 * (1.0 / max(scale + bias, 1e-3) - 1.0)), vec3f(0.0), vec3f(1.0));
}
