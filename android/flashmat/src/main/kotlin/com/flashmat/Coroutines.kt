package com.flashmat

import kotlinx.coroutines.CoroutineDispatcher
import kotlinx.coroutines.Dispatchers
import kotlinx.coroutines.channels.Channel
import kotlinx.coroutines.currentCoroutineContext
import kotlinx.coroutines.ensureActive
import kotlinx.coroutines.flow.Flow
import kotlinx.coroutines.flow.buffer
import kotlinx.coroutines.flow.channelFlow
import kotlinx.coroutines.flow.flowOn
import kotlinx.coroutines.isActive
import kotlinx.coroutines.withContext

/** What [captureFlow] emits: any number of [Progress], then one [Done]. */
public sealed interface CaptureEvent {
    /** [fraction] of [stage] is done. */
    public data class Progress(val stage: Stage, val fraction: Float) : CaptureEvent

    /** The capture's maps. */
    public data class Done(val maps: MaterialMaps) : CaptureEvent
}

/** [CaptureOptions], built in place: `captureOptions { materialClass(MaterialClass.WOOD) }`. */
public inline fun captureOptions(configure: CaptureOptions.Builder.() -> Unit): CaptureOptions =
    CaptureOptions.Builder().apply(configure).build()

/** [EngineOptions], built in place. */
public inline fun engineOptions(configure: EngineOptions.Builder.() -> Unit): EngineOptions =
    EngineOptions.Builder().apply(configure).build()

/**
 * One photo to maps on [dispatcher]; suspends meanwhile. Cancelling the coroutine stops the capture at its next step,
 * and the photo's buffers are free again when this returns or throws.
 *
 * @throws FlashmatException as [MaterialEngine.capture]
 */
public suspend fun MaterialEngine.captureAsync(
    frame: Frame,
    options: CaptureOptions = CaptureOptions.DEFAULT,
    dispatcher: CoroutineDispatcher = Dispatchers.Default,
    onProgress: (Stage, Float) -> Unit = { _, _ -> },
): MaterialMaps =
    withContext(dispatcher) {
        try {
            capture(frame, options) { stage, fraction ->
                onProgress(stage, fraction)
                isActive
            }
        } catch (cancelled: FlashmatException.Cancelled) {
            // Ours to report as a coroutine's cancellation; one by MaterialEngine.cancel() goes on as it is.
            ensureActive()
            throw cancelled
        }
    }

/**
 * One photo to maps, with progress, on [dispatcher], each time the flow is collected. A slow collector misses
 * progress, never the result; a collector that leaves stops the capture at its next step.
 */
public fun MaterialEngine.captureFlow(
    frame: Frame,
    options: CaptureOptions = CaptureOptions.DEFAULT,
    dispatcher: CoroutineDispatcher = Dispatchers.Default,
): Flow<CaptureEvent> =
    channelFlow {
        val maps =
            try {
                capture(frame, options) { stage, fraction ->
                    trySend(CaptureEvent.Progress(stage, fraction))
                    isActive
                }
            } catch (cancelled: FlashmatException.Cancelled) {
                currentCoroutineContext().ensureActive()
                throw cancelled
            }
        send(CaptureEvent.Done(maps))
    }.buffer(Channel.BUFFERED).flowOn(dispatcher)
