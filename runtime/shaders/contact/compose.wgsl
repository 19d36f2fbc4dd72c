// How contact GI and the probes make one irradiance.

// 0: energy is conserved; 1: as SDFDDGI prints it.
override PRINTED: u32 = 0u;

// gathered: irradiance from what is near, and in w the share of the hemisphere (weighted by the cosine) that is left to
// the probes. Conserving: what is near replaces the share that it covers. Printed: w is the weight of an interpolation
// (SDFDDGI, section 3.5), although the near part has been weighted by what it covers already.
fn contact_compose(gathered: vec4f, probes: vec3f) -> vec3f {
    let open = clamp(gathered.w, 0.0, 1.0);
    let near = max(gathered.rgb, vec3f(0.0));
    return select(open * probes + near, mix(near, probes, open), PRINTED != 0u);
}
