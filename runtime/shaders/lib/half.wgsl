// Where 16-bit floats end: what is stored in them is kept below, since an infinity never leaves a history again.

// The largest finite one.
const HALF_LARGEST: f32 = 65504.0;

// What radiance, irradiance and depths are kept to that are filtered afterwards.
const HALF_BOUND: f32 = 6.0e4;
