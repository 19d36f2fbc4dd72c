// The horizon integral of ground-truth ambient occlusion (Jimenez et al. 2016, "Practical real-time strategies for accurate
// indirect occlusion", section 4): a slice through a point, spanned by the way to the viewer and a direction across it.
// Angles are radians from the way to the viewer, positive across; `tilt` is that of the normal, projected into the slice.
// Twin: runtime/twins/horizon.py

const HORIZON_HALF_PI: f32 = 1.57079632679490;

// Equal parts of a slice's light: the bits of a word.
const HORIZON_SECTORS: f32 = 32.0;

// Integral of cos(x - tilt) |sin x| over x from 0 to an angle within pi, with the angle's sign.
fn horizon_integral(angle: f32, tilt: f32) -> f32 {
    let arc = 0.25 * (cos(tilt) - cos(2.0 * angle - tilt)) + 0.5 * angle * sin(tilt);
    return select(arc, -arc, angle < 0.0);
}

// The same over all that the surface sees: a right angle on both sides of the tilt.
fn horizon_slice(tilt: f32) -> f32 {
    return cos(tilt) + tilt * sin(tilt);
}

// Share of the slice's light, weighted by the cosine, that arrives from before an angle: 0 and 1 at the tangents.
fn horizon_share(angle: f32, tilt: f32) -> f32 {
    let seen = clamp(angle, tilt - HORIZON_HALF_PI, tilt + HORIZON_HALF_PI);
    let before = horizon_integral(seen, tilt) - horizon_integral(tilt - HORIZON_HALF_PI, tilt);
    return clamp(before / horizon_slice(tilt), 0.0, 1.0);
}

// The sectors between two shares. Their borders are moved by `jitter` in [0, 1) of a sector: the mean of their number
// over all jitters is exactly 32 (to_share - from_share).
fn horizon_sectors(from_share: f32, to_share: f32, jitter: f32) -> u32 {
    let first = u32(floor(HORIZON_SECTORS * from_share + jitter));
    let last = u32(floor(HORIZON_SECTORS * to_share + jitter));
    return insertBits(0u, 0xffffffffu, first, max(last, first) - first);
}
