package com.flashmat;

import androidx.annotation.NonNull;
import androidx.annotation.Nullable;

/** A material class, in the order of {@link MaterialMaps#probability}. */
public enum MaterialClass {
    /** Woven and knitted cloth. */
    FABRIC("fabric"),
    /** Soil, grass, gravel. */
    GROUND("ground"),
    /** Leather. */
    LEATHER("leather"),
    /** Metal. */
    METAL("metal"),
    /** Diffuse stone. */
    STONE_DIFF("stone-diff"),
    /** Polished stone. */
    STONE_SPEC("stone-spec"),
    /** Plastics and paint. */
    POLYMER("polymer"),
    /** Wood. */
    WOOD("wood");

    private static final MaterialClass[] ALL = values();

    private final String label;

    MaterialClass(String label) {
        this.label = label;
    }

    /** The name that reports and the command line use. */
    @NonNull
    public String label() {
        return label;
    }

    /** The class of that label; null when there is none. */
    @Nullable
    public static MaterialClass fromLabel(@NonNull String label) {
        for (MaterialClass materialClass : ALL) {
            if (materialClass.label.equals(label)) {
                return materialClass;
            }
        }
        return null;
    }

    static MaterialClass of(int number) {
        return ALL[number];
    }
}
