// Radiance and distance along the rays of every probe (Majercik et al. 2019, section 4.1): what the hit emits and
// reflects of direct light and of the last frame's probes, or the sky. Every frame turns the set of directions.

import package::ddgi::lookup::{PROBE_ON, gi_irradiance, probe_states};
import package::lib::brdf::{brdf_lambert};
import package::lib::lights::{direct_radiance_at_hit};
import package::lib::march::{trace};
import package::lib::primitives::{shape_half_thickness};
import package::lib::quaternion::{quat_rotate};
import package::lib::random::{PI, spherical_fibonacci};
import package::lib::sky::{sky_radiance_within};
import package::structs::{DdgiUpdate};
import package::world::bindings::{NO_PRIMITIVE, world_shape};

@group(0) @binding(0) var<uniform> settings: DdgiUpdate;
@group(0) @binding(1) var<storage, read_write> probe_rays: array<vec4f>;

fn incoming_radiance(origin: vec3f, direction: vec3f) -> vec4f {
    let hit = trace(origin, direction, settings.reach);
    if hit.primitive == NO_PRIMITIVE {
        return vec4f(sky_radiance_within(direction, 4.0 * PI / f32(settings.rays)), settings.reach);
    }
    let thickness = shape_half_thickness(world_shape(hit.primitive));
    var radiance = hit.emission + direct_radiance_at_hit(hit.position, hit.normal, hit.albedo, thickness);
    if settings.bounce > 0.0 {
        radiance += settings.bounce * brdf_lambert(hit.albedo, gi_irradiance(hit.position, hit.normal, -direction));
    }
    return vec4f(radiance, hit.t);
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
    let position = probe_states[probe];
    if position.w < PROBE_ON {
        return;
    }
    let ray = 64u * group.z + thread;
    let direction = quat_rotate(settings.rotation, spherical_fibonacci(ray, settings.rays));
    probe_rays[probe * settings.rays + ray] = incoming_radiance(position.xyz, direction);
}
