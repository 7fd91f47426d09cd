package com.flashmat;

import androidx.annotation.NonNull;

/** The stages of a capture, in the order in which they run. */
public enum Stage {
    /** Photo to linear RGB at the maps' size. */
    FRAME("frame"),
    /** The network: class probabilities and first maps. */
    GLOBAL("global"),
    /** Where the flash is beside the camera. */
    FLASH("flash"),
    /** Albedo below highlights. */
    HIGHLIGHT("highlight"),
    /** Refinement of the albedo. */
    ALBEDO("albedo"),
    /** Texture of the albedo that a highlight burnt out. */
    TEXTURE("texture"),
    /** Refinement of the normals. */
    NORMAL("normal"),
    /** Light scale and roughness search. */
    SEARCH("search"),
    /** Refinement of the roughness. */
    ROUGHNESS("roughness"),
    /** Roughness below highlights. */
    LEVEL("level"),
    /** Re-render, lights and residual. */
    RELIGHT("relight");

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
