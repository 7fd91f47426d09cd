package com.flashmat.sample

import android.Manifest
import android.content.Intent
import android.content.pm.PackageManager
import android.graphics.Color
import android.os.Bundle
import android.view.Gravity
import android.view.ViewGroup.LayoutParams.MATCH_PARENT
import android.view.ViewGroup.LayoutParams.WRAP_CONTENT
import android.widget.Button
import android.widget.FrameLayout
import android.widget.LinearLayout
import android.widget.TextView
import androidx.activity.result.contract.ActivityResultContracts.RequestPermission
import androidx.appcompat.app.AppCompatActivity
import androidx.camera.view.PreviewView
import androidx.lifecycle.lifecycleScope
import com.flashmat.CaptureEvent
import com.flashmat.Exposure
import com.flashmat.FlashmatException
import com.flashmat.android.Frames
import com.flashmat.captureFlow
import com.flashmat.captureOptions
import kotlin.math.tan
import kotlinx.coroutines.CancellationException
import kotlinx.coroutines.Dispatchers
import kotlinx.coroutines.Job
import kotlinx.coroutines.launch
import kotlinx.coroutines.withContext

/** Preview with the torch on, a square to aim with, a warning when too much is overexposed, one button. */
class CameraActivity : AppCompatActivity() {
    private lateinit var preview: PreviewView
    private lateinit var guide: GuideView
    private lateinit var message: TextView
    private lateinit var button: Button
    private var camera: Camera? = null
    private var running: Job? = null

    private val permission =
        registerForActivityResult(RequestPermission()) { granted ->
            if (granted) openCamera() else message.setText(R.string.no_permission)
        }

    override fun onCreate(savedInstanceState: Bundle?) {
        super.onCreate(savedInstanceState)
        setContentView(views())
        if (checkSelfPermission(Manifest.permission.CAMERA) == PackageManager.PERMISSION_GRANTED) {
            openCamera()
        } else {
            permission.launch(Manifest.permission.CAMERA)
        }
    }

    private fun views(): FrameLayout {
        preview = PreviewView(this).apply { scaleType = PreviewView.ScaleType.FIT_CENTER }
        guide = GuideView(this)
        message =
            TextView(this).apply {
                setText(R.string.guide)
                setTextColor(Color.WHITE)
                setBackgroundColor(Color.argb(160, 0, 0, 0))
                gravity = Gravity.CENTER
                setPadding(24, 24, 24, 24)
            }
        button =
            Button(this).apply {
                setText(R.string.capture)
                isEnabled = false
                setOnClickListener { if (running?.isActive == true) running?.cancel() else capture() }
            }
        val bar =
            LinearLayout(this).apply {
                orientation = LinearLayout.VERTICAL
                addView(message, MATCH_PARENT, WRAP_CONTENT)
                addView(button, MATCH_PARENT, WRAP_CONTENT)
            }
        return FrameLayout(this).apply {
            setBackgroundColor(Color.BLACK)
            addView(preview, MATCH_PARENT, MATCH_PARENT)
            addView(guide, MATCH_PARENT, MATCH_PARENT)
            addView(bar, FrameLayout.LayoutParams(MATCH_PARENT, WRAP_CONTENT, Gravity.BOTTOM))
        }
    }

    private fun openCamera() {
        lifecycleScope.launch {
            try {
                val opened = Camera.open(this@CameraActivity, this@CameraActivity, preview.surfaceProvider, ::warn)
                camera = opened
                guide.part = opened.shorterSideFov?.let { tanHalf(TARGET_FOV) / tanHalf(it) } ?: 1f
                button.isEnabled = true
            } catch (error: CancellationException) {
                throw error
            } catch (error: Exception) {
                message.text = getString(R.string.no_camera, error.message)
            }
        }
    }

    private fun warn(clipped: Float) {
        if (running?.isActive == true) {
            return
        }
        val tooBright = clipped > Exposure.OVEREXPOSED
        if (tooBright) {
            message.text = getString(R.string.too_bright, (100 * clipped).toInt())
        } else if (guide.tooBright) {
            message.setText(R.string.guide)
        }
        guide.tooBright = tooBright
    }

    private fun capture() {
        val camera = camera ?: return
        button.setText(R.string.cancel)
        running =
            lifecycleScope.launch {
                try {
                    val photo = camera.take(this@CameraActivity)
                    val frame = withContext(Dispatchers.Default) { Frames.of(photo.bitmap, photo.rotationDegrees) }
                    val options = captureOptions { camera.shorterSideFov?.let { shorterSideFov(it) } }
                    Engine.get(this@CameraActivity).captureFlow(frame, options).collect { event ->
                        when (event) {
                            is CaptureEvent.Progress -> {
                                val percent = (100 * event.fraction).toInt()
                                message.text = getString(R.string.progress, event.stage.label(), percent)
                            }
                            is CaptureEvent.Done -> {
                                Engine.lastCapture = event.maps
                                startActivity(Intent(this@CameraActivity, ResultActivity::class.java))
                            }
                        }
                    }
                    message.setText(R.string.guide)
                } catch (error: CancellationException) {
                    message.setText(R.string.guide)
                    throw error
                } catch (error: FlashmatException.BadPhoto) {
                    // The message says what would help.
                    message.text = error.message
                } catch (error: Exception) {
                    message.text = getString(R.string.failed, error.message)
                } finally {
                    button.setText(R.string.capture)
                }
            }
    }

    private companion object {
        /** What the maps span, in degrees. */
        const val TARGET_FOV = 43.35f

        fun tanHalf(degrees: Float): Float = tan(Math.toRadians(degrees / 2.0)).toFloat()
    }
}
