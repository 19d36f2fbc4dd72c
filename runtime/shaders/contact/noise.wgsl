// The random numbers of contact GI: 16 slices turned evenly in each 4 x 4 texels, as the spatial filter averages them, and
// a low-discrepancy sequence from frame to frame.

import package::contact::info::{contact};
import package::lib::random::{random_hash, random_uniform};

// Roberts 2018: the generalised golden ratio in three dimensions.
const NOISE_STEP = vec3f(0.8191725134, 0.6710436067, 0.5497004779);

// Spreads the second and third number over the 16 texels independently of the first.
const NOISE_SPREAD = vec3f(0.0625, 0.6180339887, 0.4142135624);

// Frames until the sequence begins again: few enough that float32 keeps its fractions.
const NOISE_PERIOD: u32 = 1024u;

// Turn of the slices, place of the steps, borders of the sectors; each uniform in [0, 1).
fn contact_noise(texel: vec2u) -> vec3f {
    let number = (((texel.x + texel.y) & 3u) << 2u) | (texel.x & 3u);
    let start = random_uniform(random_hash(vec3u(contact.seed, 0u, 0u)));
    return fract(start + f32(number) * NOISE_SPREAD + f32(contact.frame % NOISE_PERIOD) * NOISE_STEP);
}
