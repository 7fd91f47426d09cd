plugins {
    id("com.android.library")
    id("org.jetbrains.kotlin.android")
    id("maven-publish")
}

android {
    namespace = "com.flashmat"
    compileSdk = 36
    ndkVersion = "28.2.13676358" // r28 links with 16 KB pages by default; build-jni.sh asks for them all the same.

    defaultConfig {
        minSdk = 24
        consumerProguardFiles("consumer-rules.pro")
        testInstrumentationRunner = "androidx.test.runner.AndroidJUnitRunner"
        ndk { abiFilters += listOf("arm64-v8a", "armeabi-v7a", "x86_64") }
    }
    compileOptions {
        sourceCompatibility = JavaVersion.VERSION_1_8
        targetCompatibility = JavaVersion.VERSION_1_8
    }
    sourceSets["main"].jniLibs.srcDir(layout.buildDirectory.dir("jniLibs"))
    sourceSets["main"].assets.srcDir(layout.buildDirectory.dir("model"))
    packaging { jniLibs { useLegacyPackaging = false } }
    publishing { singleVariant("release") { withSourcesJar() } }
}

kotlin {
    explicitApi()
    compilerOptions { jvmTarget.set(org.jetbrains.kotlin.gradle.dsl.JvmTarget.JVM_1_8) }
}

dependencies {
    api("androidx.annotation:annotation:1.9.1")
    api("org.jetbrains.kotlinx:kotlinx-coroutines-core:1.10.2")
    // src/hostTest is not Gradle's: ../test-host.sh runs it on a JVM with the Linux build of the crate.
    androidTestImplementation("androidx.test:runner:1.6.2")
    androidTestImplementation("androidx.test.ext:junit:1.2.1")
}

val buildJni by tasks.registering(Exec::class) {
    description = "Builds libflashmat_jni.so for every ABI with cargo and the NDK."
    workingDir = projectDir
    environment("ANDROID_NDK_HOME", android.ndkDirectory.path)
    commandLine("./build-jni.sh", layout.buildDirectory.dir("jniLibs").get().asFile.path)
    // cargo knows what changed.
    outputs.upToDateWhen { false }
}

val copyModel by tasks.registering(Copy::class) {
    description = "Puts the product's model among the assets."
    from("../../models/phone.fmat")
    into(layout.buildDirectory.dir("model/flashmat"))
}

tasks.named("preBuild") { dependsOn(buildJni, copyModel) }

publishing {
    publications {
        register<MavenPublication>("release") {
            groupId = "com.flashmat"
            artifactId = "flashmat"
            version = providers.gradleProperty("flashmat.version").get()
            afterEvaluate { from(components["release"]) }
        }
    }
}
