package com.flashmat;

import androidx.annotation.NonNull;
import java.util.Objects;

/** What an engine is made for; immutable. */
public final class EngineOptions {
    /** 256 x 256 maps, the CPU's fastest level, one thread per CPU core. */
    public static final EngineOptions DEFAULT = new Builder().build();

    private final int size;
    private final Level level;
    private final int threads;

    private EngineOptions(Builder builder) {
        size = builder.size;
        level = builder.level;
        threads = builder.threads;
    }

    /** Pixels per side of the maps. */
    public int size() {
        return size;
    }

    /** Instruction set. */
    @NonNull
    public Level level() {
        return level;
    }

    /** Threads; 0: one per CPU core. */
    public int threads() {
        return threads;
    }

    /** Makes {@link EngineOptions}. */
    public static final class Builder {
        private int size = 256;
        private Level level = Level.AUTO;
        private int threads;

        /** Pixels per side of the maps: a multiple of 128. Memory and time grow with its square. */
        @NonNull
        public Builder size(int size) {
            this.size = size;
            return this;
        }

        /** Instruction set; the maps do not depend on it. */
        @NonNull
        public Builder level(@NonNull Level level) {
            this.level = Objects.requireNonNull(level, "level");
            return this;
        }

        /** Threads of one capture, 0 for one per CPU core; the maps do not depend on it. */
        @NonNull
        public Builder threads(int threads) {
            if (threads < 0) {
                throw new IllegalArgumentException("threads is negative: " + threads);
            }
            this.threads = threads;
            return this;
        }

        /** The options. */
        @NonNull
        public EngineOptions build() {
            return new EngineOptions(this);
        }
    }
}
