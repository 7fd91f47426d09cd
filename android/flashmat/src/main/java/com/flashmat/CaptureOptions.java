package com.flashmat;

import androidx.annotation.NonNull;
import androidx.annotation.Nullable;

/** What may be chosen for one capture; immutable. */
public final class CaptureOptions {
    /** Field of view unknown, class from the classifier, refined. */
    public static final CaptureOptions DEFAULT = new Builder().build();

    static final int FOV_UNKNOWN = 0;
    static final int FOV_SHORTER_SIDE = 1;
    static final int FOV_FOCAL = 2;

    final int fovKind;
    final float fov;
    final float targetFov;
    final float lightScale;
    final int classNumber;
    final boolean refine;

    private CaptureOptions(Builder builder) {
        fovKind = builder.fovKind;
        fov = builder.fov;
        targetFov = builder.targetFov;
        lightScale = builder.lightScale;
        classNumber = builder.materialClass == null ? -1 : builder.materialClass.ordinal();
        refine = builder.refine;
    }

    /** Makes {@link CaptureOptions}. Values are checked when the capture runs. */
    public static final class Builder {
        private int fovKind = FOV_UNKNOWN;
        private float fov;
        private float targetFov = 43.35f;
        private float lightScale;
        private MaterialClass materialClass;
        private boolean refine = true;

        /** The photo's shorter side spans {@code degrees} (1 to 170). */
        @NonNull
        public Builder shorterSideFov(float degrees) {
            fovKind = FOV_SHORTER_SIDE;
            fov = degrees;
            return this;
        }

        /** The photo was taken at a focal length of {@code mm}, 35 mm equivalent (8 to 5000; EXIF
         * FocalLengthIn35mmFilm, not FocalLength). */
        @NonNull
        public Builder focalLength35mm(float mm) {
            fovKind = FOV_FOCAL;
            fov = mm;
            return this;
        }

        /** Field of view to crop to, in degrees; 43.35, which the network was trained for, unless set. */
        @NonNull
        public Builder targetFov(float degrees) {
            targetFov = degrees;
            return this;
        }

        /**
         * Linear value that a flat white surface at the centre has at this exposure under the flash alone (0.001 to
         * 1000), measured once with white paper; 0, unless set: not known, the albedo's brightness is a guess.
         */
        @NonNull
        public Builder lightScale(float scale) {
            lightScale = scale;
            return this;
        }

        /** The class that the material surely has; null lets the classifier decide. */
        @NonNull
        public Builder materialClass(@Nullable MaterialClass materialClass) {
            this.materialClass = materialClass;
            return this;
        }

        /** Whether the network's maps are refined against the photo (slower, sharper). */
        @NonNull
        public Builder refine(boolean refine) {
            this.refine = refine;
            return this;
        }

        /** The options. */
        @NonNull
        public CaptureOptions build() {
            return new CaptureOptions(this);
        }
    }
}
