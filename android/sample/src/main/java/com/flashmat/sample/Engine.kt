package com.flashmat.sample

import android.content.Context
import com.flashmat.EngineOptions
import com.flashmat.MaterialEngine
import com.flashmat.MaterialMaps
import com.flashmat.android.BundledModel
import kotlinx.coroutines.Dispatchers
import kotlinx.coroutines.sync.Mutex
import kotlinx.coroutines.sync.withLock
import kotlinx.coroutines.withContext

/** One engine for the app's life, made when first asked for, and the last capture, for the result screen. */
object Engine {
    private val lock = Mutex()
    private var engine: MaterialEngine? = null

    /** Too large for an Intent; gone when the system ended the process, and then the result screen closes. */
    @Volatile var lastCapture: MaterialMaps? = null

    suspend fun get(context: Context): MaterialEngine =
        lock.withLock {
            engine
                ?: withContext(Dispatchers.IO) {
                    MaterialEngine(BundledModel.open(context.applicationContext), EngineOptions.DEFAULT)
                }.also { engine = it }
        }
}
