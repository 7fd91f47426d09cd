package com.flashmat;

/** A picture of a capture, as {@link MaterialMaps#encode} makes it: 8 bits a channel. */
public enum Picture {
    /** Diffuse colour, sRGB-encoded. */
    ALBEDO,
    /** (n + 1) / 2: red is x (right), green y (up), blue z (to the camera), as OpenGL and glTF have it. */
    NORMAL,
    /** Grey, linear. */
    ROUGHNESS,
    /** The maps re-rendered under the estimated flash, sRGB-encoded: to be compared with the photo. */
    RENDER,
    /** The photo as the pipeline saw it: square, upright, sRGB-encoded. */
    PHOTO
}
