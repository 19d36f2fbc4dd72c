// The octahedral maps that probes keep: texels along a side, and of the tile in the atlas, which has a border.

const IRRADIANCE_SIZE: u32 = 8u;
const IRRADIANCE_TILE: u32 = IRRADIANCE_SIZE + 2u;
const DISTANCE_SIZE: u32 = 16u;
const DISTANCE_TILE: u32 = DISTANCE_SIZE + 2u;
