// Reflection. Surfaces are Lambertian: base colour is albedo, metalness changes nothing.
// Twin: runtime/twins/brdf.py

const BRDF_PI = 3.14159265358979;

// Radiance leaving a Lambertian surface under irradiance E: rho E / pi.
fn brdf_lambert(albedo: vec3f, irradiance: vec3f) -> vec3f {
    return albedo * irradiance / BRDF_PI;
}
