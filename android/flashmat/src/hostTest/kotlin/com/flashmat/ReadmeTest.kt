package com.flashmat

import java.nio.ByteBuffer
import kotlinx.coroutines.runBlocking
import org.junit.jupiter.api.Assertions.assertEquals
import org.junit.jupiter.api.Test

/** The README's lines for Kotlin. */
class ReadmeTest {
    private suspend fun albedo(model: ByteBuffer, pixels: ByteBuffer, width: Int, height: Int): ByteBuffer {
        val options = engineOptions { threads(2) }
        return MaterialEngine(model, options).use { engine -> // in an app: make one, keep it, close() it
            val frame = Frame.rgba8(pixels, width, height, 4 * width).build()
            val maps = engine.captureAsync(frame, captureOptions { shorterSideFov(66f) })
            println("${maps.materialClass()}, residual ${maps.residual()}")
            maps.encode(Picture.ALBEDO) // RGBA, for a Bitmap
        }
    }

    @Test
    fun `the README's lines run`() = runBlocking {
        val pixels = ByteBuffer.allocateDirect(4 * 100 * 100)
        for (i in 0 until pixels.capacity()) {
            pixels.put(i, (90 + i / 4 % 100 / 20 % 2 * 60).toByte())
        }
        val side = EngineOptions.DEFAULT.size()
        assertEquals(4 * side * side, albedo(Toy.model(), pixels, 100, 100).remaining())
    }
}
