package com.flashmat.sample

import android.content.ClipData
import android.content.Intent
import android.graphics.Color
import android.os.Bundle
import android.view.ViewGroup.LayoutParams.MATCH_PARENT
import android.view.ViewGroup.LayoutParams.WRAP_CONTENT
import android.widget.Button
import android.widget.LinearLayout
import android.widget.TextView
import androidx.appcompat.app.AppCompatActivity
import androidx.core.content.FileProvider
import androidx.lifecycle.lifecycleScope
import com.flashmat.MaterialMaps
import java.io.File
import java.io.IOException
import kotlinx.coroutines.Dispatchers
import kotlinx.coroutines.launch
import kotlinx.coroutines.withContext

/** The captured material under a light to drag, what the capture says of it, and a button that shares the GLB. */
class ResultActivity : AppCompatActivity() {
    private var material: MaterialView? = null

    override fun onCreate(savedInstanceState: Bundle?) {
        super.onCreate(savedInstanceState)
        val maps = Engine.lastCapture
        if (maps == null) {
            finish()
            return
        }
        val kind = maps.materialClass()
        val percent = (100 * maps.probability(kind)).toInt()
        val text =
            TextView(this).apply {
                text = getString(R.string.result, kind.label(), percent, maps.residual())
                setTextColor(Color.WHITE)
                setPadding(24, 24, 24, 24)
            }
        val share =
            Button(this).apply {
                setText(R.string.share)
                setOnClickListener { share(maps, text) }
            }
        val view = MaterialView(this, maps)
        material = view
        setContentView(
            LinearLayout(this).apply {
                orientation = LinearLayout.VERTICAL
                setBackgroundColor(Color.BLACK)
                addView(view, LinearLayout.LayoutParams(MATCH_PARENT, 0, 1f))
                addView(text, MATCH_PARENT, WRAP_CONTENT)
                addView(share, MATCH_PARENT, WRAP_CONTENT)
            },
        )
    }

    private fun share(maps: MaterialMaps, text: TextView) {
        lifecycleScope.launch {
            try {
                val file = withContext(Dispatchers.IO) { write(maps) }
                val uri = FileProvider.getUriForFile(this@ResultActivity, "com.flashmat.sample.files", file)
                val intent =
                    Intent(Intent.ACTION_SEND).apply {
                        type = "model/gltf-binary"
                        putExtra(Intent.EXTRA_STREAM, uri)
                        clipData = ClipData.newRawUri(null, uri)
                        addFlags(Intent.FLAG_GRANT_READ_URI_PERMISSION)
                    }
                startActivity(Intent.createChooser(intent, getString(R.string.share)))
            } catch (error: IOException) {
                text.text = getString(R.string.failed, error.message)
            }
        }
    }

    private fun write(maps: MaterialMaps): File {
        val folder = File(cacheDir, "shared").apply { mkdirs() }
        val file = File(folder, "material.glb")
        file.outputStream().buffered().use { maps.writeGlb(maps.materialClass().label(), it) }
        return file
    }

    override fun onResume() {
        super.onResume()
        material?.onResume()
    }

    override fun onPause() {
        material?.onPause()
        super.onPause()
    }
}
