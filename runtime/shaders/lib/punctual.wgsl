// Suns, spots and points without shadows (KHR_lights_punctual; lux and candela read as W/m2 and W/sr).
// Twin: runtime/twins/punctual.py

import package::structs::{Light};

// The values of lights.LightKind.
const PUNCTUAL_SUN = 0u;
const PUNCTUAL_SPOT = 1u;
const PUNCTUAL_POINT = 2u;

// A lamp that touches a surface does not light it without bound.
const PUNCTUAL_SMALLEST_DISTANCE = 1e-4;

// The extension's window: 1 near the lamp, 0 past its range. A range of 0 stands for none.
fn punctual_window(distance: f32, range: f32) -> f32 {
    if range <= 0.0 {
        return 1.0;
    }
    let ratio = distance / range;
    return clamp(1.0 - ratio * ratio * ratio * ratio, 0.0, 1.0);
}

// The extension's squared falloff from the inner to the outer cone.
fn punctual_cone(cosine: f32, angle_scale: f32, angle_offset: f32) -> f32 {
    let share = clamp(cosine * angle_scale + angle_offset, 0.0, 1.0);
    return share * share;
}

// Unit vector from a position towards a light.
fn punctual_direction(light: Light, position: vec3f) -> vec3f {
    if light.kind == PUNCTUAL_SUN {
        return -light.axis;
    }
    let way = light.position - position;
    return way / max(length(way), PUNCTUAL_SMALLEST_DISTANCE);
}

// Metres from a position to a light; a sun is infinitely far.
fn punctual_distance(light: Light, position: vec3f) -> f32 {
    return select(length(light.position - position), 3.0e38, light.kind == PUNCTUAL_SUN);
}

// Share of a light's strength that reaches a surface facing it: irradiance is color times this.
fn punctual_attenuation(light: Light, position: vec3f) -> f32 {
    if light.kind == PUNCTUAL_SUN {
        return 1.0;
    }
    let distance = max(length(light.position - position), PUNCTUAL_SMALLEST_DISTANCE);
    let reach = punctual_window(distance, light.range) / (distance * distance);
    if light.kind == PUNCTUAL_POINT {
        return reach;
    }
    let cosine = -dot(light.axis, punctual_direction(light, position));
    return reach * punctual_cone(cosine, light.angle_scale, light.angle_offset);
}
