package com.flashmat;

/** What pixel values mean. */
public enum Encoding {
    /** sRGB curve, sRGB primaries. */
    SRGB,
    /** Linear light, sRGB primaries. */
    LINEAR,
    /** sRGB curve, Display P3 primaries; colours outside sRGB are clamped. */
    DISPLAY_P3
}
