package com.flashmat;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertFalse;
import static org.junit.jupiter.api.Assertions.assertSame;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.lang.reflect.Modifier;
import java.nio.ByteBuffer;
import java.util.Set;
import java.util.TreeSet;
import org.junit.jupiter.api.AfterAll;
import org.junit.jupiter.api.BeforeAll;
import org.junit.jupiter.api.Test;

/** Every error of the native library arrives as its own class, with its message. */
final class ExceptionsTest {
    private static MaterialEngine engine;

    @BeforeAll
    static void open() {
        engine = Toy.engine();
    }

    @AfterAll
    static void close() {
        engine.close();
    }

    private static <E extends FlashmatException> String refused(Class<E> kind, Frame.Builder frame) {
        String message = assertThrows(kind, () -> engine.capture(frame.build())).getMessage();
        assertFalse(message.isEmpty());
        return message;
    }

    private static Frame.Builder rgb(int bytes, int width, int height, int stride) {
        return Frame.rgb8(ByteBuffer.allocateDirect(bytes), width, height, stride);
    }

    @Test
    void everyErrorHasItsOwnClassAndTheCoresMessage() {
        Set<String> thrown = new TreeSet<>();
        for (int number = 0; ; number++) {
            int error = number;
            RuntimeException exception =
                    assertThrows(RuntimeException.class, () -> NativeBridge.fail(0, error));
            if (exception instanceof IllegalArgumentException) {
                assertEquals(number + " errors", exception.getMessage());
                break;
            }
            assertTrue(exception instanceof FlashmatException, exception.toString());
            assertTrue(exception.getMessage().length() > 5, exception.toString());
            assertTrue(thrown.add(exception.getClass().getSimpleName()), "twice: " + exception);
        }
        Set<String> family = new TreeSet<>();
        for (Class<?> member : FlashmatException.class.getDeclaredClasses()) {
            if (!Modifier.isAbstract(member.getModifiers())) {
                family.add(member.getSimpleName());
            }
        }
        family.remove("Internal");
        assertEquals(family, thrown);
    }

    @Test
    void framesThatDoNotFitTheirBuffers() {
        refused(FlashmatException.FrameEmpty.class, rgb(300, 0, 10, 30));
        refused(FlashmatException.FrameEmpty.class, rgb(300, 10, 0, 30));
        refused(FlashmatException.FrameTooLarge.class, rgb(300, Integer.MAX_VALUE, Integer.MAX_VALUE, 30));
        String stride = refused(FlashmatException.FrameStride.class, rgb(300, 10, 10, 29));
        assertTrue(stride.contains("29") && stride.contains("30"), stride);
        String buffer = refused(FlashmatException.FrameBuffer.class, rgb(299, 10, 10, 30));
        assertTrue(buffer.contains("299") && buffer.contains("300"), buffer);
        refused(FlashmatException.FrameBuffer.class, rgb(300, 10, 10, Integer.MAX_VALUE));
        refused(FlashmatException.FrameBuffer.class, rgb(0, 1, 1, 3));
        ByteBuffer y = ByteBuffer.allocateDirect(100);
        refused(
                FlashmatException.FrameBuffer.class,
                Frame.yuv420(y, 10, 1, ByteBuffer.allocateDirect(24), ByteBuffer.allocateDirect(25), 5, 1, 10, 10));
        refused(FlashmatException.FrameBuffer.class, Frame.nv21(y, 10, ByteBuffer.allocateDirect(49), 10, 10, 10));
        refused(
                FlashmatException.FrameStride.class,
                Frame.yuv420(y, 10, 0, ByteBuffer.allocateDirect(25), ByteBuffer.allocateDirect(25), 5, 1, 10, 10));
    }

    @Test
    void positionAndLimitBoundWhatIsRead() {
        ByteBuffer pixels = Toy.photo(100);
        pixels.position(3);
        refused(FlashmatException.FrameBuffer.class, Frame.rgb8(pixels, 100, 100, 300));
        pixels.position(0);
        pixels.limit(29_999);
        refused(FlashmatException.FrameBuffer.class, Frame.rgb8(pixels, 100, 100, 300));
    }

    @Test
    void photosThatCannotBeUsed() {
        ByteBuffer white = ByteBuffer.allocateDirect(30_000);
        while (white.hasRemaining()) {
            white.put((byte) 0xff);
        }
        white.flip();
        Frame.Builder overexposed = Frame.rgb8(white, 100, 100, 300);
        refused(FlashmatException.NoUsablePixels.class, overexposed);
        refused(FlashmatException.PhotoBlack.class, rgb(30_000, 100, 100, 300));
        assertTrue(refused(FlashmatException.BadPhoto.class, overexposed).contains("less exposure"));
    }

    @Test
    void floatPixelsThatAreNoLight() {
        ByteBuffer pixels = ByteBuffer.allocateDirect(12 * 16).order(java.nio.ByteOrder.nativeOrder());
        pixels.putFloat(4 * 13, Float.NaN);
        String message = refused(FlashmatException.FramePixel.class, Frame.rgbF32(pixels, 4, 4, 12));
        assertTrue(message.contains("(0, 1)"), message);
    }

    @Test
    void anglesThatMakeNoSense() {
        for (float bad : new float[] {0, -3, 171, Float.NaN, Float.POSITIVE_INFINITY}) {
            CaptureOptions photo = new CaptureOptions.Builder().shorterSideFov(bad).build();
            assertThrows(FlashmatException.FieldOfView.class, () -> engine.capture(Toy.frame(), photo));
            CaptureOptions target = new CaptureOptions.Builder().targetFov(bad).build();
            assertThrows(FlashmatException.FieldOfView.class, () -> engine.capture(Toy.frame(), target));
        }
    }

    @Test
    void lightScalesThatMakeNoSense() {
        for (float bad : new float[] {-1, 1e-4f, 2000, Float.NaN, Float.POSITIVE_INFINITY}) {
            CaptureOptions options = new CaptureOptions.Builder().lightScale(bad).build();
            assertThrows(FlashmatException.LightScale.class, () -> engine.capture(Toy.frame(), options));
        }
    }

    @Test
    void modelsThatAreNone() {
        EngineOptions options = Toy.options().build();
        ByteBuffer junk = ByteBuffer.allocateDirect(5000);
        String message = assertThrows(FlashmatException.Model.class, () -> new MaterialEngine(junk, options))
                .getMessage();
        assertTrue(message.startsWith("model: "), message);
        ByteBuffer damaged = Toy.model();
        damaged.put(3000, (byte) (damaged.get(3000) ^ 1));
        assertThrows(FlashmatException.Model.class, () -> new MaterialEngine(damaged, options));
        ByteBuffer cut = Toy.model();
        cut.limit(cut.limit() - 1);
        assertThrows(FlashmatException.Model.class, () -> new MaterialEngine(cut, options));
        ByteBuffer empty = ByteBuffer.allocateDirect(0);
        assertThrows(FlashmatException.Model.class, () -> new MaterialEngine(empty, options));
    }

    @Test
    void enginesThatCannotBe() {
        for (int size : new int[] {0, 1, 100, 129, Integer.MAX_VALUE, 1 << 30}) {
            EngineOptions options = Toy.options().size(size).build();
            assertThrows(FlashmatException.NetworkSize.class, () -> new MaterialEngine(Toy.model(), options));
        }
        EngineOptions negative = Toy.options().size(-128).build();
        assertThrows(IllegalArgumentException.class, () -> new MaterialEngine(Toy.model(), negative));
        boolean arm = System.getProperty("os.arch").contains("aarch64");
        EngineOptions foreign = Toy.options().level(arm ? Level.AVX2 : Level.NEON).build();
        assertThrows(FlashmatException.LevelUnsupported.class, () -> new MaterialEngine(Toy.model(), foreign));
    }

    @Test
    void aPanicIsAnExceptionAndTheEngineStillCloses() {
        MaterialEngine broken = Toy.engine();
        long handle = MisuseTest.handle(broken);
        FlashmatException.Internal panic =
                assertThrows(FlashmatException.Internal.class, () -> NativeBridge.fail(handle, -1));
        assertTrue(panic.getMessage().contains("on purpose"), panic.getMessage());
        assertThrows(IllegalStateException.class, () -> broken.capture(Toy.frame()));
        broken.close();
        assertEquals(Toy.SIZE, engine.capture(Toy.frame()).size(), "others go on");
    }

    @Test
    void aListenersExceptionReachesTheCaller() {
        RuntimeException mine = new RuntimeException("mine");
        RuntimeException caught = assertThrows(
                RuntimeException.class,
                () -> engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> {
                    if (stage == Stage.ALBEDO) {
                        throw mine;
                    }
                    return true;
                }));
        assertSame(mine, caught);
        assertEquals(Toy.SIZE, engine.capture(Toy.frame()).size(), "the engine goes on");
    }
}
