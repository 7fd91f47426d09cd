package com.flashmat.sample

import android.annotation.SuppressLint
import android.content.Context
import android.opengl.GLES30
import android.opengl.GLSurfaceView
import android.view.MotionEvent
import com.flashmat.MaterialMaps
import com.flashmat.Picture
import java.nio.ByteBuffer
import java.nio.ByteOrder
import javax.microedition.khronos.egl.EGLConfig
import javax.microedition.khronos.opengles.GL10
import kotlin.math.min
import kotlin.math.tan

/** The material, seen from (0, 0, 1), under a light that follows the finger. */
@SuppressLint("ClickableViewAccessibility", "ViewConstructor")
class MaterialView(context: Context, maps: MaterialMaps) : GLSurfaceView(context) {
    private val renderer = MaterialRenderer(maps)

    init {
        setEGLContextClientVersion(3)
        setRenderer(renderer)
        renderMode = RENDERMODE_WHEN_DIRTY
    }

    override fun onTouchEvent(event: MotionEvent): Boolean {
        val half = min(width, height) / 2f
        renderer.lightX = (event.x - width / 2f) / half
        renderer.lightY = (height / 2f - event.y) / half
        requestRender()
        return true
    }
}

/** Draws one square with the product's microfacet model (its docs name the equations). */
private class MaterialRenderer(private val maps: MaterialMaps) : GLSurfaceView.Renderer {
    /** The light's position over the square, in half sides from the middle, y up. */
    @Volatile var lightX = -0.5f
    @Volatile var lightY = 0.5f

    private val halfTan = tan(Math.toRadians(maps.fieldOfView() / 2.0)).toFloat()
    private var program = 0

    /** A field: GL reads the memory at each draw, and nothing else keeps it. */
    private val corners =
        ByteBuffer.allocateDirect(4 * 8).order(ByteOrder.nativeOrder()).asFloatBuffer().apply {
            put(floatArrayOf(-1f, -1f, 1f, -1f, -1f, 1f, 1f, 1f)).rewind()
        }

    override fun onSurfaceCreated(gl: GL10?, config: EGLConfig?) {
        program = link(VERTEX, FRAGMENT)
        GLES30.glUseProgram(program)
        texture(0, "albedo", Picture.ALBEDO, GLES30.GL_SRGB8_ALPHA8)
        texture(1, "normal", Picture.NORMAL, GLES30.GL_RGBA8)
        texture(2, "roughness", Picture.ROUGHNESS, GLES30.GL_RGBA8)
        GLES30.glUniform1f(uniform("halfTan"), halfTan)
        GLES30.glUniform1f(uniform("f0"), maps.f0())
        GLES30.glEnableVertexAttribArray(0)
        GLES30.glVertexAttribPointer(0, 2, GLES30.GL_FLOAT, false, 0, corners)
    }

    override fun onSurfaceChanged(gl: GL10?, width: Int, height: Int) {
        val side = min(width, height)
        GLES30.glViewport((width - side) / 2, (height - side) / 2, side, side)
    }

    override fun onDrawFrame(gl: GL10?) {
        GLES30.glClear(GLES30.GL_COLOR_BUFFER_BIT)
        GLES30.glUniform3f(uniform("light"), lightX * halfTan, lightY * halfTan, LIGHT_HEIGHT)
        GLES30.glDrawArrays(GLES30.GL_TRIANGLE_STRIP, 0, 4)
    }

    private fun uniform(name: String) = GLES30.glGetUniformLocation(program, name)

    private fun texture(unit: Int, name: String, picture: Picture, format: Int) {
        val ids = IntArray(1)
        GLES30.glGenTextures(1, ids, 0)
        GLES30.glActiveTexture(GLES30.GL_TEXTURE0 + unit)
        GLES30.glBindTexture(GLES30.GL_TEXTURE_2D, ids[0])
        val size = maps.size()
        val pixels = maps.encode(picture)
        GLES30.glTexImage2D(
            GLES30.GL_TEXTURE_2D, 0, format, size, size, 0, GLES30.GL_RGBA, GLES30.GL_UNSIGNED_BYTE, pixels,
        )
        GLES30.glGenerateMipmap(GLES30.GL_TEXTURE_2D)
        val clamp = GLES30.GL_CLAMP_TO_EDGE
        GLES30.glTexParameteri(GLES30.GL_TEXTURE_2D, GLES30.GL_TEXTURE_MIN_FILTER, GLES30.GL_LINEAR_MIPMAP_LINEAR)
        GLES30.glTexParameteri(GLES30.GL_TEXTURE_2D, GLES30.GL_TEXTURE_MAG_FILTER, GLES30.GL_LINEAR)
        GLES30.glTexParameteri(GLES30.GL_TEXTURE_2D, GLES30.GL_TEXTURE_WRAP_S, clamp)
        GLES30.glTexParameteri(GLES30.GL_TEXTURE_2D, GLES30.GL_TEXTURE_WRAP_T, clamp)
        GLES30.glUniform1i(uniform(name), unit)
    }

    private fun link(vertex: String, fragment: String): Int {
        val linked = GLES30.glCreateProgram()
        GLES30.glAttachShader(linked, compile(GLES30.GL_VERTEX_SHADER, vertex))
        GLES30.glAttachShader(linked, compile(GLES30.GL_FRAGMENT_SHADER, fragment))
        GLES30.glLinkProgram(linked)
        val status = IntArray(1)
        GLES30.glGetProgramiv(linked, GLES30.GL_LINK_STATUS, status, 0)
        check(status[0] == GLES30.GL_TRUE) { GLES30.glGetProgramInfoLog(linked) }
        return linked
    }

    private fun compile(kind: Int, source: String): Int {
        val shader = GLES30.glCreateShader(kind)
        GLES30.glShaderSource(shader, source)
        GLES30.glCompileShader(shader)
        val status = IntArray(1)
        GLES30.glGetShaderiv(shader, GLES30.GL_COMPILE_STATUS, status, 0)
        check(status[0] == GLES30.GL_TRUE) { GLES30.glGetShaderInfoLog(shader) }
        return shader
    }

    private companion object {
        /** Nearer than the camera (1), so that the highlight moves visibly. */
        const val LIGHT_HEIGHT = 0.7f

        val VERTEX =
            """
            #version 300 es
            layout(location = 0) in vec2 corner;
            out vec2 p;
            void main() {
                p = corner;
                gl_Position = vec4(corner, 0.0, 1.0);
            }
            """.trimIndent()

        val FRAGMENT =
            """
            #version 300 es
            precision highp float;
            in vec2 p;
            out vec4 colour;
            uniform sampler2D albedo;
            uniform sampler2D normal;
            uniform sampler2D roughness;
            uniform float halfTan;
            uniform float f0;
            uniform vec3 light;
            const float PI = 3.14159265;

            float visibility(float cosine, float k) {
                return 1.0 / (cosine * (1.0 - k) + k);
            }

            void main() {
                // Texture rows run from the top.
                vec2 uv = vec2(p.x * 0.5 + 0.5, 0.5 - p.y * 0.5);
                vec3 d = texture(albedo, uv).rgb;
                vec3 n = normalize(texture(normal, uv).xyz * 2.0 - 1.0);
                float r = texture(roughness, uv).r;
                vec3 point = vec3(p * halfTan, 0.0);
                vec3 toLight = light - point;
                vec3 l = normalize(toLight);
                vec3 v = normalize(vec3(0.0, 0.0, 1.0) - point);
                vec3 h = normalize(l + v);
                float nl = max(dot(n, l), 0.0);
                float nv = max(dot(n, v), 1e-4);
                float nh = clamp(dot(n, h), 0.0, 1.0);
                float vh = clamp(dot(v, h), 0.0, 1.0);
                float alpha = clamp(r * r, 1e-3, 1.0);
                float root = 1.0 - nh * nh + nh * nh * alpha * alpha;
                float distribution = alpha * alpha / (PI * root * root);
                float fresnel = f0 + (1.0 - f0) * exp2((-5.55473 * vh - 6.98316) * vh);
                float k = (r + 1.0) * (r + 1.0) / 8.0;
                // D F G / (4 n.l n.v), with n.l and n.v cancelled against G.
                float specular = distribution * fresnel * visibility(nl, k) * visibility(nv, k) / 4.0;
                float strength = PI / dot(toLight, toLight) * light.z * light.z;
                vec3 radiance = (d / PI + specular) * nl * strength;
                vec3 linear = clamp(radiance, 0.0, 1.0);
                vec3 low = 12.92 * linear;
                vec3 high = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
                colour = vec4(mix(low, high, step(0.0031308, linear)), 1.0);
            }
            """.trimIndent()
    }
}
