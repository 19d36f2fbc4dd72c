// What a probe does, kept beside its position.

const PROBE_ON: f32 = 1.0;

// Moved or brought in a moment ago: it is traced, but holds no light of its new place yet.
const PROBE_FRESH: f32 = 0.75;
const PROBE_ASLEEP: f32 = 0.5;
const PROBE_INSIDE: f32 = 0.0;
