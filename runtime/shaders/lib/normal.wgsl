// A unit vector in 32 bits: octahedral coordinates of 16 bits each, exact along the axes, within 6e-5 elsewhere.
// Twin: runtime/twins/normal.py

import package::lib::octahedral::{oct_encode, oct_decode};

fn normal_pack(direction: vec3f) -> u32 {
    return pack2x16snorm(oct_encode(direction));
}

fn normal_unpack(bits: u32) -> vec3f {
    return oct_decode(unpack2x16snorm(bits));
}
