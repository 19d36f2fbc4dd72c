// No global illumination: nothing arrives but direct light.

fn gi_irradiance(position: vec3f, normal: vec3f, view: vec3f) -> vec3f {
    return vec3f(0.0);
}

fn gi_radiance(position: vec3f, direction: vec3f) -> vec3f {
    return vec3f(0.0);
}
