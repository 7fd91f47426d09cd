package com.flashmat

import java.util.concurrent.CountDownLatch
import java.util.concurrent.TimeUnit
import kotlinx.coroutines.CancellationException
import kotlinx.coroutines.async
import kotlinx.coroutines.cancelAndJoin
import kotlinx.coroutines.flow.first
import kotlinx.coroutines.flow.toList
import kotlinx.coroutines.launch
import kotlinx.coroutines.runBlocking
import org.junit.jupiter.api.Assertions.assertEquals
import org.junit.jupiter.api.Assertions.assertThrows
import org.junit.jupiter.api.Assertions.assertTrue
import org.junit.jupiter.api.Test
import org.junit.jupiter.api.Timeout

/** The Kotlin side: suspend functions and flows behave as Kotlin's do. */
@Timeout(120)
class CoroutinesTest {
    @Test
    fun `suspending gives the maps that blocking gives`() = runBlocking {
        Toy.engine().use { engine ->
            val seen = mutableSetOf<Stage>()
            val maps = engine.captureAsync(Toy.frame(), onProgress = { stage, _ -> seen += stage })
            assertEquals(engine.capture(Toy.frame()).albedo(), maps.albedo())
            assertEquals(Stage.entries.toSet(), seen)
        }
    }

    @Test
    fun `cancelling the coroutine stops the capture`() = runBlocking {
        Toy.engine().use { engine ->
            val inside = CountDownLatch(1)
            val goOn = CountDownLatch(1)
            var last: Stage? = null
            var caught: Throwable? = null
            val job = launch(kotlinx.coroutines.Dispatchers.Default) {
                try {
                    engine.captureAsync(Toy.frame(), onProgress = { stage, _ ->
                        last = stage
                        inside.countDown()
                        goOn.await(60, TimeUnit.SECONDS)
                    })
                } catch (error: Throwable) {
                    caught = error
                    throw error
                }
            }
            inside.await()
            job.cancel()
            goOn.countDown()
            job.join()
            assertTrue(caught is CancellationException, "$caught")
            assertEquals(Stage.FRAME, last)
            assertEquals(Toy.SIZE, engine.captureAsync(Toy.frame()).size())
        }
    }

    @Test
    fun `errors and the engine's own cancel come as they are`() = runBlocking {
        Toy.engine().use { engine ->
            val black = Frame.rgb8(java.nio.ByteBuffer.allocateDirect(300), 10, 10, 30).build()
            assertThrows(FlashmatException.PhotoBlack::class.java) { runBlocking { engine.captureAsync(black) } }
            assertThrows(FlashmatException.Cancelled::class.java) {
                runBlocking { engine.captureAsync(Toy.frame(), onProgress = { _, _ -> engine.cancel() }) }
            }
            Unit
        }
    }

    @Test
    fun `a flow tells progress and then the maps`() = runBlocking {
        Toy.engine().use { engine ->
            val events = engine.captureFlow(Toy.frame(), captureOptions { refine(false) }).toList()
            val done = events.last() as CaptureEvent.Done
            assertEquals(Toy.SIZE, done.maps.size())
            assertTrue(events.dropLast(1).all { it is CaptureEvent.Progress })
            assertEquals(CaptureEvent.Progress(Stage.FRAME, 0f), events.first())
        }
    }

    @Test
    fun `a collector that leaves stops the capture`() = runBlocking {
        Toy.engine().use { engine ->
            assertTrue(engine.captureFlow(Toy.frame()).first() is CaptureEvent.Progress)
            val job = async(kotlinx.coroutines.Dispatchers.Default) { engine.captureFlow(Toy.frame()).toList() }
            job.cancelAndJoin()
            assertEquals(Toy.SIZE, engine.captureAsync(Toy.frame()).size())
        }
    }

    @Test
    fun `nulls from Kotlin do not compile and options read as Kotlin`() {
        val options = engineOptions {
            size(Toy.SIZE)
            threads(1)
        }
        MaterialEngine(Toy.model(), options).use { engine -> assertEquals(Toy.SIZE, engine.size()) }
    }
}
