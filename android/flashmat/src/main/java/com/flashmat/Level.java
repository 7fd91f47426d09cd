package com.flashmat;

/** An instruction set; all give the same maps, to the bit. {@link #AUTO} is the fastest that the CPU has. */
public enum Level {
    /** The fastest one that this CPU has. */
    AUTO,
    /** Plain loops, any CPU. */
    SCALAR,
    /** x86-64 with AVX2 (emulators, Chromebooks). */
    AVX2,
    /** x86-64 with AVX-512 VNNI. */
    AVX512VNNI,
    /** Every 64-bit ARM CPU. */
    NEON,
    /** 64-bit ARM with the dot-product extension. */
    DOTPROD,
    /** 64-bit ARM with the int8 matrix-multiply extension. */
    I8MM;

    /** The native library's number; -1 for AUTO. */
    int number() {
        return ordinal() - 1;
    }
}
