// Irradiance of all lamps at a point off its surface, by a ray to each: no shadow map has a say.

import package::lib::light_list::{lighting, lights};
import package::lib::punctual::{punctual_attenuation, punctual_direction, punctual_distance};
import package::tracer::sights::{sight_is_free};

fn lamps_irradiance(position: vec3f, normal: vec3f) -> vec3f {
    var total = vec3f(0.0);
    for (var i = 0u; i < lighting.count; i++) {
        let light = lights[i];
        let towards = punctual_direction(light, position);
        let strength = dot(normal, towards) * punctual_attenuation(light, position);
        if strength > 0.0 && sight_is_free(position, towards, punctual_distance(light, position)) {
            total += light.color * strength;
        }
    }
    return total;
}
