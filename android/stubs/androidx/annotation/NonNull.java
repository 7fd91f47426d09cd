package androidx.annotation;

/** Stands in for AndroidX, which checks without Gradle do not have. */
public @interface NonNull {}
