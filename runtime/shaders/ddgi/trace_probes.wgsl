// Radiance and distance along the rays of every probe (Majercik et al. 2019, section 4.1): what the hit reflects of direct
// light and of the last frame's probes, and emits where `ddgi/draw_emitters` does not count that; or the sky. Every frame
// turns the set of directions.

import package::ddgi::lookup::{gi_irradiance, probe_states};
import package::ddgi::states::{PROBE_FRESH};
import package::lib::brdf::{brdf_lambert};
import package::lib::quaternion::{quat_rotate};
import package::lib::random::{PI, spherical_fibonacci};
import package::lib::sky::{sky_radiance_within};
import package::probes::emitters::{emission_is_drawn};
import package::structs::{DdgiUpdate};
import package::tracer::reflections::{reflected_radiance};
import package::tracer::sights::{sight_along};

@group(0) @binding(0) var<uniform> settings: DdgiUpdate;
@group(0) @binding(1) var<storage, read_write> probe_rays: array<vec4f>;

fn incoming_radiance(origin: vec3f, direction: vec3f) -> vec4f {
    let seen = sight_along(origin, direction, settings.reach);
    if !seen.is_hit {
        return vec4f(sky_radiance_within(direction, 4.0 * PI / f32(settings.rays)), settings.reach);
    }
    var radiance = reflected_radiance(seen);
    if !emission_is_drawn(seen) {
        radiance += seen.emission;
    }
    if settings.bounce > 0.0 {
        radiance += settings.bounce * brdf_lambert(seen.albedo, gi_irradiance(seen.position, seen.normal, -direction));
    }
    return vec4f(radiance, seen.t);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let probe = group.x + group.y * groups.x;
    if probe >= settings.probe_count {
        return;
    }
    let position = probe_states[settings.first_probe + probe];
    if position.w < PROBE_FRESH {
        return;
    }
    let ray = 64u * group.z + thread;
    let direction = quat_rotate(settings.rotation, spherical_fibonacci(ray, settings.rays));
    probe_rays[probe * settings.rays + ray] = incoming_radiance(position.xyz, direction);
}
