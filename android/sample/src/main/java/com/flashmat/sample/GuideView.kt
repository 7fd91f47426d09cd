package com.flashmat.sample

import android.content.Context
import android.graphics.Canvas
import android.graphics.Color
import android.graphics.Paint
import android.view.View
import kotlin.math.min

/** The square that will be captured, over a preview that fits the view and keeps 3:4. */
class GuideView(context: Context) : View(context) {
    /** Part of the photo's shorter side that the square takes. */
    var part = 1f
        set(value) {
            field = value.coerceIn(0.1f, 1f)
            invalidate()
        }

    /** Whether to warn. */
    var tooBright = false
        set(value) {
            if (field != value) {
                field = value
                invalidate()
            }
        }

    private val line = Paint(Paint.ANTI_ALIAS_FLAG).apply { style = Paint.Style.STROKE }

    override fun onDraw(canvas: Canvas) {
        val previewWidth = min(width.toFloat(), height * 3f / 4f)
        val half = previewWidth * part / 2
        val x = width / 2f
        val y = height / 2f
        line.strokeWidth = 2 * resources.displayMetrics.density
        line.color = if (tooBright) Color.rgb(255, 96, 64) else Color.WHITE
        canvas.drawRect(x - half, y - half, x + half, y + half, line)
        // The lamp's reflection belongs in the middle.
        canvas.drawCircle(x, y, half / 8, line)
    }
}
