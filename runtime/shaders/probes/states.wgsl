// What the w of a probe's position tells: the scale of its map, or why it must not be read.

// It found no place.
const PROBE_OFF: f32 = -1.0;

// It has a place, but no light of it yet: it came in, or jumped, a moment ago.
const PROBE_FRESH: f32 = -0.5;

// Whether a probe has a place, and whether it may be read.
fn probe_is_placed(state: f32) -> bool {
    return state >= PROBE_FRESH;
}

fn probe_is_lit(state: f32) -> bool {
    return state >= 0.0;
}
