package com.flashmat;

import androidx.annotation.NonNull;

/** The stages of a capture, in the order in which they run. */
public enum Stage {
    /** Photo to linear RGB at the network's size. */
    FRAME("frame"),
    /** Class probabilities and first maps. */
    NET("net"),
    /** Refinement of the albedo. */
    CRF_ALBEDO("crf_albedo"),
    /** Refinement of the normals. */
    CRF_NORMAL("crf_normal"),
    /** Light scale and per-pixel roughness search. */
    SEARCH("search"),
    /** Refinement of the roughness. */
    CRF_ROUGHNESS("crf_roughness");

    private static final Stage[] ALL = values();

    private final String label;

    Stage(String label) {
        this.label = label;
    }

    /** The name that reports use. */
    @NonNull
    public String label() {
        return label;
    }

    static Stage of(int number) {
        return ALL[number];
    }
}
