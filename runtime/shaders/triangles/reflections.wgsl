// Direct light that a triangle reflects, W/m2/sr: by a ray to every lamp.

import package::lib::brdf::{brdf_lambert};
import package::lib::sight::{Sight};
import package::paths::lamps::{lamps_irradiance};

fn reflected_radiance(seen: Sight) -> vec3f {
    return brdf_lambert(seen.albedo, lamps_irradiance(seen.position, seen.normal));
}
