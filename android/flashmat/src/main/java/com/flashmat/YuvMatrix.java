package com.flashmat;

/** Which luma equation a camera used. */
public enum YuvMatrix {
    /** JPEG, and Android's cameras unless they say otherwise. */
    BT601,
    /** HD video. */
    BT709
}
