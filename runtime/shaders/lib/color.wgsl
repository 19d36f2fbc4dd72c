// Linear Rec.709 colour: luminance, the sRGB transfer function (IEC 61966-2-1) and the tone curves.
// Twin: runtime/twins/color.py

// The values of settings.ToneCurve.
const COLOR_TONE_LINEAR = 0u;
const COLOR_TONE_REINHARD = 1u;
const COLOR_TONE_ACES = 2u;

fn color_luminance(rgb: vec3f) -> f32 {
    return dot(rgb, vec3f(0.2126, 0.7152, 0.0722));
}

fn color_srgb_from_linear(rgb: vec3f) -> vec3f {
    let clamped = clamp(rgb, vec3f(0.0), vec3f(1.0));
    let power = 1.055 * pow(clamped, vec3f(1.0 / 2.4)) - 0.055;
    return select(power, 12.92 * clamped, clamped <= vec3f(0.0031308));
}

fn color_linear_from_srgb(srgb: vec3f) -> vec3f {
    let clamped = clamp(srgb, vec3f(0.0), vec3f(1.0));
    let power = pow((clamped + 0.055) / 1.055, vec3f(2.4));
    return select(power, clamped / 12.92, clamped <= vec3f(0.04045));
}

// x / (1 + x) in each channel (Reinhard et al. 2002, eq. 3).
fn color_tone_reinhard(rgb: vec3f) -> vec3f {
    return rgb / (1.0 + rgb);
}

// Narkowicz's rational fit of the ACES curve (2015). Past 1e4 it is white to 8 bits; its squares must not overflow.
fn color_tone_aces(rgb: vec3f) -> vec3f {
    let x = min(rgb, vec3f(1e4));
    return clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), vec3f(0.0), vec3f(1.0));
}

// Linear light to linear display values in [0, 1]: exposure in stops, then the curve.
fn color_tone(rgb: vec3f, exposure: f32, curve: u32) -> vec3f {
    let exposed = max(rgb, vec3f(0.0)) * exp2(exposure);
    switch curve {
        case COLOR_TONE_REINHARD: { return color_tone_reinhard(exposed); }
        case COLOR_TONE_ACES: { return color_tone_aces(exposed); }
        default: { return clamp(exposed, vec3f(0.0), vec3f(1.0)); }
    }
}
