// What a probe does, kept beside its position.

const PROBE_ON: f32 = 1.0;

// Moved or brought in a moment ago: it is traced, but holds no light of its new place yet.
const PROBE_FRESH: f32 = 0.75;
const PROBE_ASLEEP: f32 = 0.5;
const PROBE_INSIDE: f32 = 0.0;

// Share of the old values that a probe keeps after so many frames. A new probe would need hundreds of frames to forget
// its first: until hysteresis stands for more, it is the mean of a share of its frames, and forgets the oldest, which
// lack bounces.
fn ddgi_kept(frames: u32, hysteresis: f32, growth: f32) -> f32 {
    let kept = min(hysteresis, 1.0 - 1.0 / max(f32(frames + 1u) * growth, 1.0));
    return select(kept, 0.0, frames == 0u);
}
