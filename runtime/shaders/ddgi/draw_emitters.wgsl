// What small surfaces that shine send to every probe, W/m2 at each texel of its map: by draws, since its rays would find
// them by chance alone. No part of the method as its authors give it.

import package::ddgi::lookup::{probe_states};
import package::ddgi::states::{PROBE_FRESH};
import package::lib::octahedral::{oct_texel_direction};
import package::lib::random::{random_hash, random_uniform};
import package::probes::emitters::{probe_emission};
import package::probes::maps::{IRRADIANCE_SIZE};
import package::structs::{DdgiUpdate};

@group(0) @binding(0) var<uniform> settings: DdgiUpdate;
@group(0) @binding(1) var<storage, read_write> drawn_irradiance: array<vec4f>;

const THREADS: u32 = IRRADIANCE_SIZE * IRRADIANCE_SIZE;

@compute @workgroup_size(8, 8)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) texel: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let traced = group.x + group.y * groups.x;
    if traced >= settings.probe_count {
        return;
    }
    let probe = settings.first_probe + traced;
    let position = probe_states[probe];
    if position.w < PROBE_FRESH {
        return;
    }
    let normal = oct_texel_direction(texel.xy, IRRADIANCE_SIZE);
    let turn = random_uniform(random_hash(vec3u(probe, bitcast<vec2u>(settings.rotation.xy))));
    let drawn = probe_emission(position.xyz, normal, thread, settings.reach, turn);
    drawn_irradiance[traced * THREADS + thread] = vec4f(drawn.irradiance, 1.0);
}
