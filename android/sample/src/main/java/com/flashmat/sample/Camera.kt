package com.flashmat.sample

import android.content.Context
import android.graphics.Bitmap
import android.hardware.camera2.CameraCharacteristics
import android.util.Size
import androidx.annotation.OptIn
import androidx.camera.camera2.interop.Camera2CameraInfo
import androidx.camera.camera2.interop.ExperimentalCamera2Interop
import androidx.camera.core.CameraInfo
import androidx.camera.core.CameraSelector
import androidx.camera.core.ImageAnalysis
import androidx.camera.core.ImageCapture
import androidx.camera.core.ImageCaptureException
import androidx.camera.core.ImageProxy
import androidx.camera.core.Preview
import androidx.camera.core.resolutionselector.AspectRatioStrategy
import androidx.camera.core.resolutionselector.ResolutionSelector
import androidx.camera.core.resolutionselector.ResolutionStrategy
import androidx.camera.lifecycle.ProcessCameraProvider
import androidx.camera.lifecycle.awaitInstance
import androidx.core.content.ContextCompat
import androidx.lifecycle.LifecycleOwner
import com.flashmat.Exposure
import kotlin.coroutines.resume
import kotlin.coroutines.resumeWithException
import kotlin.math.atan
import kotlin.math.min
import kotlinx.coroutines.suspendCancellableCoroutine

/** A photo as the capture wants it. */
class Photo(val bitmap: Bitmap, val rotationDegrees: Int)

/** CameraX, with the torch on: preview, photos, and how much of the picture is overexposed. */
class Camera private constructor(private val capture: ImageCapture, val shorterSideFov: Float?) {
    /** One photo. */
    suspend fun take(context: Context): Photo =
        suspendCancellableCoroutine { continuation ->
            capture.takePicture(
                ContextCompat.getMainExecutor(context),
                object : ImageCapture.OnImageCapturedCallback() {
                    override fun onCaptureSuccess(image: ImageProxy) {
                        val photo = image.use { Photo(it.toBitmap(), it.imageInfo.rotationDegrees) }
                        continuation.resume(photo)
                    }

                    override fun onError(error: ImageCaptureException) = continuation.resumeWithException(error)
                },
            )
        }

    companion object {
        /** Opens the back camera for as long as [owner] is started; [onClipped] gets the overexposed part, 0 to 1. */
        suspend fun open(
            context: Context,
            owner: LifecycleOwner,
            surface: Preview.SurfaceProvider,
            onClipped: (Float) -> Unit,
        ): Camera {
            val provider = ProcessCameraProvider.awaitInstance(context)
            val preview =
                Preview.Builder().setResolutionSelector(fourToThree(1280, 960)).build().also {
                    it.surfaceProvider = surface
                }
            // 2048 pixels over the longer side are eight times what the maps have.
            val capture =
                ImageCapture.Builder()
                    .setCaptureMode(ImageCapture.CAPTURE_MODE_MAXIMIZE_QUALITY)
                    .setFlashMode(ImageCapture.FLASH_MODE_OFF)
                    .setResolutionSelector(fourToThree(2048, 1536))
                    .build()
            val analysis =
                ImageAnalysis.Builder()
                    .setResolutionSelector(fourToThree(640, 480))
                    .setBackpressureStrategy(ImageAnalysis.STRATEGY_KEEP_ONLY_LATEST)
                    .build()
            analysis.setAnalyzer(ContextCompat.getMainExecutor(context)) { image ->
                image.use {
                    val y = it.planes[0]
                    onClipped(Exposure.clippedShare(y.buffer, it.width, it.height, y.rowStride, y.pixelStride, 4))
                }
            }
            provider.unbindAll()
            val camera =
                provider.bindToLifecycle(owner, CameraSelector.DEFAULT_BACK_CAMERA, preview, capture, analysis)
            if (camera.cameraInfo.hasFlashUnit()) {
                camera.cameraControl.enableTorch(true)
            }
            return Camera(capture, fieldOfView(camera.cameraInfo))
        }

        private fun fourToThree(width: Int, height: Int) =
            ResolutionSelector.Builder()
                .setAspectRatioStrategy(AspectRatioStrategy.RATIO_4_3_FALLBACK_AUTO_STRATEGY)
                .setResolutionStrategy(
                    ResolutionStrategy(
                        Size(width, height),
                        ResolutionStrategy.FALLBACK_RULE_CLOSEST_HIGHER_THEN_LOWER,
                    ),
                )
                .build()

        /** Degrees over the sensor's shorter side; null when the camera does not tell. */
        @OptIn(ExperimentalCamera2Interop::class)
        private fun fieldOfView(info: CameraInfo): Float? {
            val camera = Camera2CameraInfo.from(info)
            val sensor = camera.getCameraCharacteristic(CameraCharacteristics.SENSOR_INFO_PHYSICAL_SIZE)
            val focal =
                camera.getCameraCharacteristic(CameraCharacteristics.LENS_INFO_AVAILABLE_FOCAL_LENGTHS)?.firstOrNull()
            if (sensor == null || focal == null || focal <= 0) {
                return null
            }
            val degrees = Math.toDegrees(2 * atan(min(sensor.width, sensor.height) / (2.0 * focal))).toFloat()
            return degrees.takeIf { it in 1f..170f }
        }
    }
}
