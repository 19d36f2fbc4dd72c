// Direct light that a primitive reflects, W/m2/sr: from the reflective shadow maps where they see it.

import package::lib::lights::{direct_radiance_at_hit};
import package::lib::sight::{Sight};

fn reflected_radiance(seen: Sight) -> vec3f {
    return direct_radiance_at_hit(seen.position, seen.normal, seen.albedo, seen.half_thickness);
}
