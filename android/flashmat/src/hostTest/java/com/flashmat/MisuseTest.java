package com.flashmat;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertFalse;
import static org.junit.jupiter.api.Assertions.assertNull;
import static org.junit.jupiter.api.Assertions.assertSame;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.lang.reflect.Field;
import java.nio.ByteBuffer;
import java.util.ArrayList;
import java.util.List;
import java.util.concurrent.CountDownLatch;
import java.util.concurrent.TimeUnit;
import java.util.concurrent.atomic.AtomicBoolean;
import java.util.concurrent.atomic.AtomicReference;
import org.junit.jupiter.api.AfterEach;
import org.junit.jupiter.api.BeforeEach;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.api.Timeout;

/** Wrong and unlucky calls are exceptions, never crashes or hangs. */
@Timeout(120)
final class MisuseTest {
    private MaterialEngine engine;

    @BeforeEach
    void open() {
        engine = Toy.engine();
    }

    @AfterEach
    void close() {
        engine.close();
    }

    static long handle(MaterialEngine engine) {
        try {
            Field field = MaterialEngine.class.getDeclaredField("handle");
            field.setAccessible(true);
            return field.getLong(engine);
        } catch (ReflectiveOperationException error) {
            throw new AssertionError(error);
        }
    }

    @Test
    void nullArguments() {
        Class<NullPointerException> npe = NullPointerException.class;
        assertThrows(npe, () -> new MaterialEngine(null, EngineOptions.DEFAULT));
        assertThrows(npe, () -> new MaterialEngine(Toy.model(), null));
        assertThrows(npe, () -> engine.capture(null));
        assertThrows(npe, () -> engine.capture(Toy.frame(), null));
        assertThrows(npe, () -> engine.capture(Toy.frame(), CaptureOptions.DEFAULT, null, null));
        assertThrows(npe, () -> Frame.rgb8(null, 1, 1, 3));
        assertThrows(npe, () -> Frame.nv12(Toy.photo(8), 8, null, 8, 8, 8));
        assertThrows(npe, () -> Frame.yuv420(Toy.photo(8), 8, 1, Toy.photo(8), null, 8, 1, 8, 8));
        assertThrows(npe, () -> Toy.options().level(null));
    }

    @Test
    void heapBuffers() {
        ByteBuffer heap = ByteBuffer.allocate(30_000);
        assertThrows(IllegalArgumentException.class, () -> Frame.rgb8(heap, 100, 100, 300));
        assertThrows(IllegalArgumentException.class, () -> new MaterialEngine(heap, EngineOptions.DEFAULT));
        MaterialMaps maps = engine.capture(Toy.frame());
        assertThrows(IllegalArgumentException.class, () -> maps.encode(Picture.ALBEDO, ByteBuffer.allocate(1 << 16)));
    }

    /** The native side must not trust the Java side: the same mistakes, past the Java checks. */
    @Test
    void theBridgeChecksForItself() {
        long handle = handle(engine);
        ByteBuffer pixels = Toy.photo(100);
        ByteBuffer heap = ByteBuffer.allocate(30_000);
        ByteBuffer maps = new MaterialMaps(Toy.SIZE).memory;
        float[] numbers = new float[NativeBridge.NUMBERS];
        int[] layout = Toy.frame().layout();
        Class<IllegalArgumentException> iae = IllegalArgumentException.class;
        Class<NullPointerException> npe = NullPointerException.class;
        assertThrows(npe, () -> call(handle, null, pixels, -1, maps, numbers));
        assertThrows(npe, () -> call(handle, layout, null, -1, maps, numbers));
        assertThrows(npe, () -> call(handle, layout, pixels, -1, null, numbers));
        assertThrows(npe, () -> call(handle, layout, pixels, -1, maps, null));
        assertThrows(npe, () -> NativeBridge.create(null, 128, -1, 1));
        assertThrows(iae, () -> call(handle, layout, heap, -1, maps, numbers));
        assertThrows(iae, () -> call(handle, layout, pixels, -1, heap, numbers));
        assertThrows(iae, () -> call(handle, new int[3], pixels, -1, maps, numbers));
        assertThrows(iae, () -> call(handle, layout, pixels, 8, maps, numbers));
        assertThrows(iae, () -> call(handle, layout, pixels, -2, maps, numbers));
        assertThrows(iae, () -> call(handle, layout, pixels, -1, maps, new float[18]));
        assertThrows(iae, () -> call(handle, layout, maps, -1, maps, numbers), "overlap");
        ByteBuffer small = ByteBuffer.allocateDirect(4 * 14 * 128 * 128 - 1);
        assertThrows(iae, () -> call(handle, layout, pixels, -1, small, numbers));
        ByteBuffer odd = ByteBuffer.allocateDirect(4 * 14 * 128 * 128 + 8);
        odd.position(1);
        ByteBuffer unaligned = odd.slice();
        assertThrows(iae, () -> call(handle, layout, pixels, -1, unaligned, numbers));
        for (int field = 0; field < layout.length; field++) {
            int[] wrong = layout.clone();
            wrong[field] = -1;
            assertThrows(iae, () -> call(handle, wrong, pixels, -1, maps, numbers), "layout " + field);
            int at = field;
            if (field == 0 || field >= 7) {
                int[] unknown = layout.clone();
                unknown[at] = 8;
                assertThrows(iae, () -> call(handle, unknown, pixels, -1, maps, numbers), "layout " + field);
            }
        }
        int[] yuv = layout.clone();
        yuv[0] = 7;
        assertThrows(npe, () -> call(handle, yuv, pixels, -1, maps, numbers), "a YUV frame needs its chroma");
        ByteBuffer odd16 = ByteBuffer.allocateDirect(61_000);
        odd16.position(1);
        Frame wide = Frame.rgb16(odd16, 100, 100, 300).build();
        assertThrows(iae, () -> engine.capture(wide));
        assertThrows(iae, () -> NativeBridge.create(Toy.model(), 128, 6, 1));
        assertThrows(iae, () -> NativeBridge.create(Toy.model(), 128, -1, -1));
        assertThrows(iae, () -> NativeBridge.picture(maps, 128, 5, maps));
        assertThrows(iae, () -> NativeBridge.picture(maps, 65_536, 0, pixels));
        assertThrows(iae, () -> NativeBridge.picture(maps, Integer.MAX_VALUE, 0, pixels));
        assertThrows(iae, () -> NativeBridge.picture(maps, -1, 0, pixels));
        byte[] name = {'o', 'a', 'k'};
        assertThrows(npe, () -> NativeBridge.glb(null, 128, 0.05f, 40, name));
        assertThrows(npe, () -> NativeBridge.glb(maps, 128, 0.05f, 40, null));
        assertThrows(iae, () -> NativeBridge.glb(maps, 0, 0.05f, 40, name));
        assertThrows(iae, () -> NativeBridge.glb(maps, -1, 0.05f, 40, name));
        assertThrows(iae, () -> NativeBridge.glb(maps, 65_536, 0.05f, 40, name));
        assertThrows(iae, () -> NativeBridge.glb(maps, 128, Float.NaN, 40, name));
        assertThrows(iae, () -> NativeBridge.glb(maps, 128, 0.05f, 180, name));
        assertThrows(iae, () -> NativeBridge.glb(maps, 128, 0.05f, 40, new byte[] {(byte) 0xff}));
    }

    private static void call(
            long handle, int[] layout, ByteBuffer pixels, int materialClass, ByteBuffer maps, float[] numbers) {
        NativeBridge.capture(
                handle, layout, pixels, null, null, 0, 0, 43.35f, 0, materialClass, false, null, maps, numbers);
    }

    @Test
    void handlesFromNowhere() {
        for (long handle : new long[] {0, 1, -1, Long.MIN_VALUE, Long.MAX_VALUE, handle(engine) + 1000}) {
            assertThrows(IllegalStateException.class, () -> NativeBridge.workspaceBytes(handle), "" + handle);
            assertThrows(IllegalStateException.class, () -> NativeBridge.level(handle), "" + handle);
        }
    }

    @Test
    void aClosedEngine() {
        Frame frame = Toy.frame();
        engine.close();
        engine.close();
        engine.cancel();
        Class<IllegalStateException> ise = IllegalStateException.class;
        assertEquals("the engine is closed", assertThrows(ise, () -> engine.capture(frame)).getMessage());
        assertThrows(ise, engine::level);
        assertThrows(ise, engine::workspaceBytes);
        assertThrows(ise, engine::modelMeta);
        assertThrows(ise, engine::modelChecksum);
    }

    @Test
    void mapsOutliveTheirEngine() {
        MaterialMaps maps = engine.capture(Toy.frame());
        float before = maps.albedo().get(5);
        engine.close();
        assertEquals(before, maps.albedo().get(5));
        assertThrows(java.nio.ReadOnlyBufferException.class, () -> maps.albedo().put(0, 1f));
    }

    @Test
    void mapsWithoutACapture() {
        MaterialMaps maps = new MaterialMaps(Toy.SIZE);
        assertThrows(IllegalStateException.class, maps::albedo);
        assertThrows(IllegalStateException.class, maps::materialClass);
        Frame black = Frame.rgb8(ByteBuffer.allocateDirect(300), 10, 10, 30).build();
        engine.capture(Toy.frame(), CaptureOptions.DEFAULT, maps, null);
        assertTrue(maps.albedo().hasRemaining());
        assertThrows(
                FlashmatException.PhotoBlack.class,
                () -> engine.capture(black, CaptureOptions.DEFAULT, maps, null));
        assertThrows(IllegalStateException.class, maps::albedo, "a failed capture leaves none");
        MaterialMaps large = new MaterialMaps(256);
        assertThrows(
                IllegalArgumentException.class,
                () -> engine.capture(Toy.frame(), CaptureOptions.DEFAULT, large, null));
        assertThrows(IllegalArgumentException.class, () -> new MaterialMaps(0));
        assertThrows(IllegalArgumentException.class, () -> new MaterialMaps(1 << 20));
    }

    @Test
    void closingWaitsForTheCaptureThatRuns() throws InterruptedException {
        CountDownLatch inside = new CountDownLatch(1);
        CountDownLatch goOn = new CountDownLatch(1);
        List<String> order = java.util.Collections.synchronizedList(new ArrayList<>());
        AtomicReference<Throwable> failure = new AtomicReference<>();
        Thread runner = new Thread(() -> {
            try {
                MaterialMaps maps = engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> {
                    inside.countDown();
                    await(goOn);
                    return true;
                });
                assertTrue(maps.albedo().hasRemaining());
            } catch (Throwable error) {
                failure.set(error);
            }
            order.add("captured");
        });
        Thread closer = new Thread(() -> {
            engine.close();
            order.add("closed");
        });
        runner.start();
        await(inside);
        closer.start();
        closer.join(300);
        assertTrue(closer.isAlive(), "close() waits");
        Frame late = Toy.frame();
        assertThrows(IllegalStateException.class, () -> engine.capture(late), "no new captures meanwhile");
        goOn.countDown();
        closer.join();
        runner.join();
        assertNull(failure.get(), "the capture is not disturbed");
        assertEquals(2, order.size());
    }

    private static void await(CountDownLatch latch) {
        try {
            assertTrue(latch.await(60, TimeUnit.SECONDS));
        } catch (InterruptedException error) {
            throw new AssertionError(error);
        }
    }

    @Test
    void callingBackIntoTheOwnEngineIsRefused() {
        AtomicReference<RuntimeException> closing = new AtomicReference<>();
        AtomicReference<RuntimeException> capturing = new AtomicReference<>();
        MaterialMaps maps = engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> {
            closing.set(assertThrows(IllegalStateException.class, engine::close));
            capturing.set(assertThrows(IllegalStateException.class, () -> engine.capture(Toy.frame())));
            return true;
        });
        assertTrue(maps.albedo().hasRemaining());
        assertTrue(closing.get().getMessage().contains("listener"));
        assertTrue(capturing.get().getMessage().contains("listener"));
        assertEquals(Toy.SIZE, engine.capture(Toy.frame()).size(), "still open");
    }

    @Test
    void anotherEngineMayBeUsedInAListener() {
        try (MaterialEngine other = Toy.engine()) {
            AtomicReference<MaterialMaps> inner = new AtomicReference<>();
            MaterialMaps outer = engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> {
                if (inner.get() == null) {
                    inner.set(other.capture(Toy.frame()));
                }
                return true;
            });
            assertEquals(outer.albedo(), inner.get().albedo());
        }
    }

    @Test
    void twoThreadsTakeTurns() throws InterruptedException {
        MaterialMaps expected = engine.capture(Toy.frame());
        AtomicReference<Throwable> failure = new AtomicReference<>();
        AtomicBoolean busy = new AtomicBoolean();
        List<Thread> threads = new ArrayList<>();
        for (int i = 0; i < 4; i++) {
            Thread thread = new Thread(() -> {
                try {
                    for (int round = 0; round < 3; round++) {
                        MaterialMaps maps = engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> {
                            if (stage == Stage.FRAME && fraction == 0) {
                                assertFalse(busy.getAndSet(true), "one at a time");
                            } else if (stage == Stage.RELIGHT && fraction == 1) {
                                busy.set(false);
                            }
                            return true;
                        });
                        assertEquals(expected.albedo(), maps.albedo());
                        assertEquals(expected.roughness(), maps.roughness());
                    }
                } catch (Throwable error) {
                    failure.set(error);
                }
            });
            threads.add(thread);
            thread.start();
        }
        for (Thread thread : threads) {
            thread.join();
        }
        assertNull(failure.get());
    }

    @Test
    void twoThreadsCloseAtOnce() throws InterruptedException {
        AtomicReference<Throwable> failure = new AtomicReference<>();
        for (int round = 0; round < 10; round++) {
            MaterialEngine shared = Toy.engine();
            Thread[] closers = new Thread[4];
            for (int i = 0; i < closers.length; i++) {
                closers[i] = new Thread(shared::close);
                closers[i].setUncaughtExceptionHandler((thread, error) -> failure.set(error));
                closers[i].start();
            }
            for (Thread closer : closers) {
                closer.join();
            }
        }
        assertNull(failure.get());
    }

    @Test
    void cancellingStopsWhatRunsAndNothingElse() {
        List<Stage> seen = new ArrayList<>();
        assertThrows(
                FlashmatException.Cancelled.class,
                () -> engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> {
                    seen.add(stage);
                    if (stage == Stage.ALBEDO) {
                        engine.cancel();
                    }
                    return true;
                }));
        assertSame(Stage.ALBEDO, seen.get(seen.size() - 1));
        engine.cancel();
        assertEquals(Toy.SIZE, engine.capture(Toy.frame()).size(), "a cancel before the call is not its");
        assertThrows(
                FlashmatException.Cancelled.class,
                () -> engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> false));
    }

    @Test
    void progressRunsThroughAllStagesAndNeverFalls() {
        List<Stage> stages = new ArrayList<>();
        float[] last = {0};
        engine.capture(Toy.frame(), CaptureOptions.DEFAULT, (stage, fraction) -> {
            if (stages.isEmpty() || stages.get(stages.size() - 1) != stage) {
                stages.add(stage);
                last[0] = 0;
            }
            assertTrue(fraction >= last[0] && fraction <= 1, stage + " " + fraction);
            last[0] = fraction;
            return true;
        });
        assertEquals(java.util.Arrays.asList(Stage.values()), stages);
    }
}
