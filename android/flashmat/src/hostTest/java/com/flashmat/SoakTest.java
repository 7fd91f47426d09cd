package com.flashmat;

import static org.junit.jupiter.api.Assertions.assertTrue;

import java.io.IOException;
import java.nio.charset.StandardCharsets;
import java.nio.file.Files;
import java.nio.file.Path;
import java.nio.file.Paths;
import java.util.ArrayList;
import java.util.List;
import org.junit.jupiter.api.Test;

/**
 * Many captures on one engine, and engines opened and closed, do not grow the process. {@code
 * -Dcom.flashmat.captures=10000} for the long run; prints a table. One in {@code -Dcom.flashmat.refine=20} is refined:
 * the refinement allocates nothing, and takes most of a capture's time.
 */
final class SoakTest {
    /** Resident memory in kB; -1 where the system does not tell. */
    private static long residentKb() throws IOException {
        Path status = Paths.get("/proc/self/status");
        if (!Files.exists(status)) {
            return -1;
        }
        for (String line : Files.readAllLines(status, StandardCharsets.ISO_8859_1)) {
            if (line.startsWith("VmRSS:")) {
                return Long.parseLong(line.replaceAll("\\D", ""));
            }
        }
        return -1;
    }

    @Test
    void memoryStaysFlat() throws IOException {
        int captures = Integer.getInteger("com.flashmat.captures", 300);
        List<Long> resident = new ArrayList<>();
        long started = System.nanoTime();
        System.out.printf("%9s %12s %12s %8s%n", "captures", "resident kB", "heap kB", "seconds");
        CaptureOptions refined = new CaptureOptions.Builder().build();
        CaptureOptions quick = new CaptureOptions.Builder().refine(false).build();
        int period = Integer.getInteger("com.flashmat.refine", 20);
        MaterialMaps maps = new MaterialMaps(Toy.SIZE);
        int done = 0;
        try (MaterialEngine engine = Toy.engine()) {
            for (int tenth = 0; tenth <= 10; tenth++) {
                for (int until = Math.max(captures * tenth / 10, 20); done < until; done++) {
                    CaptureOptions options = done % period == 0 ? refined : quick;
                    engine.capture(Toy.frame(), options, maps, (stage, fraction) -> true);
                    if (done % 50 == 0) {
                        // Every path that allocates on the native side: pictures, errors, cancelled runs, engines.
                        maps.encode(Picture.ALBEDO);
                        try {
                            engine.capture(Toy.frame(), refined, (stage, fraction) -> stage == Stage.FRAME);
                            throw new AssertionError("not cancelled");
                        } catch (FlashmatException.Cancelled expected) {
                            Toy.engine().close();
                        }
                    }
                }
                System.gc();
                resident.add(residentKb());
                Runtime runtime = Runtime.getRuntime();
                System.out.printf(
                        "%9d %12d %12d %8.1f%n",
                        done,
                        resident.get(tenth),
                        (runtime.totalMemory() - runtime.freeMemory()) / 1024,
                        (System.nanoTime() - started) / 1e9);
            }
        }
        // The first readings are the JVM warming up; a leak of one maps buffer per capture would be 896 kB each.
        long early = resident.get(3);
        long late = resident.get(10);
        assertTrue(late - early < 16 * 1024, "resident memory grew from " + early + " to " + late + " kB");
    }
}
