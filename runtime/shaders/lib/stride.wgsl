// How far sphere tracing dares to go from a point around which a ball of `radius` is free.
//
// A stride longer than the radius is a guess, right where the next ball meets this one. The guesses differ in what they
// take for the slope of the distance along the ray: -1 head-on, 0 along a wall, 1 away from it. Before a plane of that
// slope the next ball touches this one after 2 radius / (1 - slope).

const STRIDE_PLAIN: u32 = 0u;
const STRIDE_RELAXED: u32 = 1u;
const STRIDE_ENHANCED: u32 = 2u;
const STRIDE_AUTO: u32 = 3u;

// Keinert et al. 2014, section 3.1: all strides are so many radii long, until one was too long.
const STRIDE_RELAXATION: f32 = 1.2;

// Balint and Valasek 2018, section 3: share of the way beyond the radius that is dared.
const STRIDE_TRUST: f32 = 0.9;

// Ban and Valasek 2023: weight of the last slope in the mean of all.
const STRIDE_MEAN_WEIGHT: f32 = 0.3;

// Larger slopes are not believed: behind the wall that is left there comes another one.
const STRIDE_STEEPEST: f32 = 0.5;

// Slope of which nothing is known, or that was not kept to: strides are plain.
const STRIDE_HEAD_ON: f32 = -1.0;

// The slope that a ray starts with.
fn stride_first_slope(method: u32) -> f32 {
    return select(STRIDE_HEAD_ON, 0.0, method == STRIDE_RELAXED);
}

// The slope to go by after a stride that was kept to, along which the distance had the slope `measured`.
fn stride_next_slope(method: u32, slope: f32, measured: f32) -> f32 {
    let seen = clamp(measured, STRIDE_HEAD_ON, STRIDE_STEEPEST);
    if method == STRIDE_RELAXED {
        return slope;
    }
    return select(seen, mix(slope, seen, STRIDE_MEAN_WEIGHT), method == STRIDE_AUTO);
}

fn stride_length(method: u32, radius: f32, slope: f32) -> f32 {
    if method == STRIDE_PLAIN || slope <= STRIDE_HEAD_ON {
        return radius;
    }
    if method == STRIDE_RELAXED {
        return STRIDE_RELAXATION * radius;
    }
    if method == STRIDE_ENHANCED {
        return radius + STRIDE_TRUST * radius * (1.0 + slope) / (1.0 - slope);
    }
    return 2.0 * radius / (1.0 - slope);
}
