package com.flashmat;

import androidx.annotation.NonNull;

/**
 * Told how far a capture is, on the capturing thread.
 *
 * <p>It must not call {@link MaterialEngine#capture} or {@link MaterialEngine#close} of the engine that calls it (both
 * throw {@link IllegalStateException}). What it throws stops the capture and reaches the caller of {@code capture}.
 */
public interface ProgressListener {
    /**
     * {@code fraction} of {@code stage} is done: 0 at its start, 1 at its end, never falling within a stage.
     *
     * @return true to go on; false makes the capture throw {@link FlashmatException.Cancelled}
     */
    boolean onProgress(@NonNull Stage stage, float fraction);
}
