package com.flashmat;

/** Which codes black and white have in YUV. */
public enum YuvRange {
    /** Luma 0 to 255: JPEG, Android's cameras. */
    FULL,
    /** Luma 16 to 235: video. */
    LIMITED
}
