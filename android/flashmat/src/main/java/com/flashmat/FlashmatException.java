package com.flashmat;

/**
 * Why a capture, or an engine, could not be had. The message says what is wrong and, where it can, what would help.
 *
 * <p>One nested class for each error of the native library, so that an app can catch the ones that it has an answer
 * for: {@link BadPhoto} means "take another photo", {@link Cancelled} that the app itself stopped the capture. The
 * others are mistakes of the calling code or of the model file. Unchecked, as most are.
 *
 * <p>Arguments that are null give {@link NullPointerException}, buffers that are not direct
 * {@link IllegalArgumentException}, calls on a closed engine {@link IllegalStateException}.
 */
public abstract class FlashmatException extends RuntimeException {
    private static final long serialVersionUID = 1L;

    FlashmatException(String message) {
        super(message);
    }

    /** The photo cannot be used; another one, taken as the message says, can. */
    public abstract static class BadPhoto extends FlashmatException {
        private static final long serialVersionUID = 1L;

        BadPhoto(String message) {
            super(message);
        }
    }

    /** Every pixel is overexposed. */
    public static final class NoUsablePixels extends BadPhoto {
        private static final long serialVersionUID = 1L;

        NoUsablePixels(String message) {
            super(message);
        }
    }

    /** The photo is black where it is not overexposed. */
    public static final class PhotoBlack extends BadPhoto {
        private static final long serialVersionUID = 1L;

        PhotoBlack(String message) {
            super(message);
        }
    }

    /** {@link MaterialEngine#cancel()} was called, or the listener returned false. */
    public static final class Cancelled extends FlashmatException {
        private static final long serialVersionUID = 1L;

        Cancelled(String message) {
            super(message);
        }
    }

    /** The photo has no pixels. */
    public static final class FrameEmpty extends FlashmatException {
        private static final long serialVersionUID = 1L;

        FrameEmpty(String message) {
            super(message);
        }
    }

    /** The photo's sides or bytes exceed what can be addressed. */
    public static final class FrameTooLarge extends FlashmatException {
        private static final long serialVersionUID = 1L;

        FrameTooLarge(String message) {
            super(message);
        }
    }

    /** A stride is smaller than what it steps over. */
    public static final class FrameStride extends FlashmatException {
        private static final long serialVersionUID = 1L;

        FrameStride(String message) {
            super(message);
        }
    }

    /** A plane's buffer ends before its last pixel. */
    public static final class FrameBuffer extends FlashmatException {
        private static final long serialVersionUID = 1L;

        FrameBuffer(String message) {
            super(message);
        }
    }

    /** A float pixel is NaN, infinite or negative. */
    public static final class FramePixel extends FlashmatException {
        private static final long serialVersionUID = 1L;

        FramePixel(String message) {
            super(message);
        }
    }

    /** A known scale of the light ({@link CaptureOptions.Builder#lightScale}) outside 0.001 to 1000. */
    public static final class LightScale extends FlashmatException {
        private static final long serialVersionUID = 1L;

        LightScale(String message) {
            super(message);
        }
    }

    /** A field of view outside 1 to 170 degrees. */
    public static final class FieldOfView extends FlashmatException {
        private static final long serialVersionUID = 1L;

        FieldOfView(String message) {
            super(message);
        }
    }

    /** A focal length, 35 mm equivalent, outside 8 to 5000 mm: a phone's real one (4 to 9 mm), as a rule. */
    public static final class FocalLength extends FlashmatException {
        private static final long serialVersionUID = 1L;

        FocalLength(String message) {
            super(message);
        }
    }

    /** A size in pixels that is not supported. */
    public static final class Size extends FlashmatException {
        private static final long serialVersionUID = 1L;

        Size(String message) {
            super(message);
        }
    }

    /** A plane of pixels is shorter or longer than its size says. */
    public static final class PlaneLength extends FlashmatException {
        private static final long serialVersionUID = 1L;

        PlaneLength(String message) {
            super(message);
        }
    }

    /** The light or the camera is not above the plane. */
    public static final class LightBelowPlane extends FlashmatException {
        private static final long serialVersionUID = 1L;

        LightBelowPlane(String message) {
            super(message);
        }
    }

    /** The engine's workspace cannot be had: the device is short of memory. */
    public static final class WorkspaceTooSmall extends FlashmatException {
        private static final long serialVersionUID = 1L;

        WorkspaceTooSmall(String message) {
            super(message);
        }
    }

    /** The system gave no threads. */
    public static final class Threads extends FlashmatException {
        private static final long serialVersionUID = 1L;

        Threads(String message) {
            super(message);
        }
    }

    /** The bytes are not a model that this version can run. */
    public static final class Model extends FlashmatException {
        private static final long serialVersionUID = 1L;

        Model(String message) {
            super(message);
        }
    }

    /** The network cannot run at this size. */
    public static final class NetworkSize extends FlashmatException {
        private static final long serialVersionUID = 1L;

        NetworkSize(String message) {
            super(message);
        }
    }

    /** This CPU does not have the instruction set asked for. */
    public static final class LevelUnsupported extends FlashmatException {
        private static final long serialVersionUID = 1L;

        LevelUnsupported(String message) {
            super(message);
        }
    }

    /** A map that was to be refined holds values out of all measure. */
    public static final class CrfInput extends FlashmatException {
        private static final long serialVersionUID = 1L;

        CrfInput(String message) {
            super(message);
        }
    }

    /** A defect of the library; the engine that it happened in only closes. Please report it. */
    public static final class Internal extends FlashmatException {
        private static final long serialVersionUID = 1L;

        Internal(String message) {
            super(message);
        }
    }
}
