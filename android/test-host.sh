#!/usr/bin/env bash
# Tests the Android library on this machine's JVM: the same native crate, built for Linux, under -Xcheck:jni.
#   android/test-host.sh             FLASHMAT_CAPTURES=10000 FLASHMAT_REFINE=1 for the long memory test
# Needs cargo, a JDK (8 or later, 17 tested); installs JUnit 5 with apt and the Kotlin compiler with npm where missing.
# Prints "N passed, N failed"; fails on any failed test and on any WARNING or FATAL of the JVM's JNI checks.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(dirname "$here")
target=$(cd "$root" && cargo metadata --format-version 1 --no-deps --locked --offline 2>/dev/null |
  sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
target=${target:-$root/target}
out=$target/android-host
tools=${FLASHMAT_TOOLS:-$target/tools}
rm -rf "$out"
mkdir -p "$out/classes" "$out/test" "$out/artefacts" "$tools"

junit_names=(junit-platform-console junit-platform-commons junit-platform-engine junit-platform-launcher
  junit-platform-reporting junit-jupiter-api junit-jupiter-engine junit-jupiter-params opentest4j
  opentest4j-reporting-events opentest4j-reporting-schema apiguardian-api picocli univocity-parsers)
find_junit() {
  local path="" name
  for name in "${junit_names[@]}"; do
    [ -e "/usr/share/java/$name.jar" ] || return 1
    path=$path:/usr/share/java/$name.jar
  done
  printf '%s' "${path#:}"
}
if ! junit=$(find_junit); then
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  $sudo apt-get update -qq
  $sudo apt-get -o DPkg::Lock::Timeout=600 install -y -qq --no-install-recommends junit5 junit4 >"$out/apt.log"
  junit=$(find_junit) || { echo "test-host.sh: no JUnit 5 in /usr/share/java" >&2; exit 1; }
fi
kotlin=$tools/node_modules/kotlin-compiler
[ -e "$kotlin/lib/kotlin-compiler.jar" ] ||
  npm install --silent --no-fund --no-audit --prefix "$tools" kotlin-compiler@2.4.20
libs=$kotlin/lib/kotlin-stdlib.jar:$kotlin/lib/kotlinx-coroutines-core-jvm.jar:$kotlin/lib/annotations-13.0.jar

version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$root/Cargo.toml" | head -1)
grep -qx "flashmat.version=$version" "$here/gradle.properties" ||
  { echo "test-host.sh: gradle.properties has another version than Cargo.toml ($version)" >&2; exit 1; }

echo "-- native library and what the Rust API says"
(cd "$root" && cargo build -p flashmat-jni --features test-hooks --locked --lib --example reference)
"$target/debug/examples/reference" "$out/test/reference.bin"
cp "$root/tests/golden/toy.fmat" "$out/test/"

echo "-- Java and Kotlin"
lib=$here/flashmat/src
# Everything but com.flashmat.android, which needs a device's classes: check-cross.sh compiles that.
javac --release 8 -Xlint:all,-options -Werror -d "$out/classes" "$here"/stubs/androidx/annotation/*.java \
  "$lib"/main/java/com/flashmat/*.java
kotlinc() { bash "$kotlin/bin/kotlinc-jvm" -no-stdlib -no-reflect -nowarn "$@"; }
kotlinc -jvm-target 1.8 -Xexplicit-api=strict -cp "$out/classes:$libs" -d "$out/classes" "$lib"/main/kotlin/com/flashmat/*.kt
javac --release 8 -Xlint:all,-options,-processing,-classfile,-path -d "$out/test" -cp "$out/classes:$junit" \
  "$lib"/hostTest/java/com/flashmat/*.java
kotlinc -jvm-target 1.8 -cp "$out/classes:$out/test:$libs:$junit" -d "$out/test" "$lib"/hostTest/kotlin/com/flashmat/*.kt

echo "-- tests under -Xcheck:jni"
log=$out/test.log
status=0
java -Xcheck:jni -Xmx256m -XX:MaxDirectMemorySize=256m -Dcom.flashmat.library="$target/debug/libflashmat_jni.so" \
  -Dcom.flashmat.captures="${FLASHMAT_CAPTURES:-300}" -Dcom.flashmat.refine="${FLASHMAT_REFINE:-20}" -Dcom.flashmat.artefacts="$out/artefacts" \
  -cp "$out/classes:$out/test:$libs:$junit" org.junit.platform.console.ConsoleLauncher \
  --scan-classpath "$out/test" --details "${FLASHMAT_DETAILS:-tree}" --disable-banner --disable-ansi-colors >"$log" 2>&1 || status=$?
grep -v '^\[ .* \(containers\|aborted\|skipped\)' "$log" || true
count() { sed -n "s/^\[ *\([0-9]*\) tests $1 *\]\$/\1/p" "$log" | tail -1; }
passed=$(count successful) failed=$(count failed)
checks=$(grep -cE '^(WARNING|FATAL)' "$log" || true)
if [ "$checks" != 0 ]; then
  echo "test-host.sh: the JVM's JNI checks complained $checks times:" >&2
  grep -E -A4 '^(WARNING|FATAL)' "$log" | head -40 >&2
  status=1
fi
viewer=$root/tests/viewer
if [ -d "$viewer/node_modules/gltf-validator" ]; then
  (cd "$viewer" && node validate.mjs "$out/artefacts/toy.glb") || status=1
else
  echo "NOT RUN: Khronos' glTF validator (npm ci in tests/viewer installs it)"
fi
echo "${passed:-0} passed, ${failed:-1} failed"
[ "$status" = 0 ] && [ "${failed:-1}" = 0 ] && [ "${passed:-0}" -gt 0 ]
