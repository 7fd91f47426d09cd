#!/usr/bin/env bash
# What can be checked of the Android build without the NDK, Gradle and a device, from Debian's packages alone:
#   1 core (no_std) and the JNI crate compiled for aarch64-linux-android, the crate also for 32-bit ARM
#   2 the library linked against stubs of bionic (an allow-list of imports), its exports and page alignment looked at
#   3 the kernels' tests and the golden network results on aarch64 under qemu, with all CPU features and with none but NEON
#   4 the Java sources compiled against a real android.jar, and a signed APK of them put together
#   android/check-cross.sh [STEP...]    all of them unless named: compile link golden apk
# Says "NOT RUN" and why for what the machine cannot do; that is no failure. The .so made here cannot run: its unwinder
# and bionic are stubs. The real one comes from flashmat/build-jni.sh.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(dirname "$here")
cd "$root"
target=${CARGO_TARGET_DIR:-$root/target}
tools=${FLASHMAT_TOOLS:-$target/tools}
cross=${FLASHMAT_CROSS:-$tools/cross}
out=$target/android-check
built=$target/android-cross
rm -rf "$out"
mkdir -p "$out" "$tools"
steps=("$@")
[ ${#steps[@]} -gt 0 ] || steps=(compile link golden apk)
wanted() { case " ${steps[*]} " in *" $1 "*) ;; *) return 1 ;; esac }
not_run() { echo "NOT RUN: $*"; }
fail() { echo "check-cross.sh: $*" >&2; exit 1; }
checked=0
ok() { checked=$((checked + 1)); echo "ok: $*"; }

packages() { # installs what is missing; false where it cannot
  local missing=() name
  for name in "$@"; do
    dpkg-query -W -f '${Status}' "$name" 2>/dev/null | grep -q 'ok installed' || missing+=("$name")
  done
  [ ${#missing[@]} = 0 ] && return
  command -v apt-get >/dev/null || return 1
  local sudo=
  [ "$(id -u)" = 0 ] || sudo=sudo
  $sudo apt-get update -qq &&
    $sudo apt-get -o DPkg::Lock::Timeout=600 install -y -qq --no-install-recommends "${missing[@]}" >"$out/apt.log" 2>&1
}

if [ "${steps[*]}" != apk ] && ! toolchain=$(tools/cross-toolchain.sh "$cross" 2>&1); then
  not_run "compile, link and golden: no cross toolchain ($(echo "$toolchain" | tail -1))"
  steps=(apk)
fi
cargo=$cross/bin/cargo
export RUSTC_BOOTSTRAP=1
android=(--target aarch64-linux-android --target-dir "$built" --locked)
std=(-Zbuild-std=std,panic_unwind)

stubs() { # libraries with the allowed imports, and no others
  mkdir -p "$out/stub"
  local clang=(clang --target=aarch64-linux-android24 -fPIC -w -x c -c) library
  for library in c m dl log; do
    sed -n "s/^$library //p" "$here/check/bionic.txt" | tr ' ' '\n' | sed '/^$/d; s/.*/void &(void) {}/' |
      "${clang[@]}" -fno-builtin -o "$out/stub/$library.o" -
    ld.lld -shared -soname "lib$library.so" -o "$out/stub/lib$library.so" "$out/stub/$library.o"
  done
  sed -n 's/^unwind //p' "$here/check/bionic.txt" | tr ' ' '\n' | sed '/^$/d; s/.*/void &(void) {}/' |
    "${clang[@]}" -o "$out/stub/unwind.o" -
  llvm-ar rcs "$out/stub/libunwind.a" "$out/stub/unwind.o"
  cat >"$out/stub/android-clang" <<EOF
#!/bin/sh
exec clang --target=aarch64-linux-android24 -fuse-ld=lld -nostartfiles -nostdlib -Wl,-z,defs -L"$out/stub" \\
  -Wl,-z,max-page-size=16384 "\$@"
EOF
  chmod +x "$out/stub/android-clang"
}

lib=$built/aarch64-linux-android/release/libflashmat_jni.so
if { wanted compile || wanted link; } && [ -x "$cargo" ]; then
  if packages clang lld llvm; then
    stubs
    export CARGO_TARGET_AARCH64_LINUX_ANDROID_LINKER=$out/stub/android-clang
    "$cargo" build "${std[@]}" --release "${android[@]}" -p flashmat-jni --lib
    ok "flashmat-jni compiled and linked for aarch64-linux-android"
  else
    not_run "compile and link: clang, lld and llvm cannot be installed"
    steps=(golden apk)
  fi
fi
if wanted compile && [ -x "$cargo" ]; then
  "$cargo" check "${std[@]}" --release "${android[@]}" -p flashmat-core --no-default-features
  ok "flashmat-core without std and alloc checked for aarch64-linux-android"
  if [ -n "${FLASHMAT_CHECK_ARMV7:-}" ]; then
    "$cargo" check "${std[@]}" --target armv7-linux-androideabi --target-dir "$built" --locked -p flashmat-jni
    ok "flashmat-jni compiled for 32-bit ARM"
  else
    not_run "32-bit ARM: another standard library to build; FLASHMAT_CHECK_ARMV7=1 runs it"
  fi
fi

if wanted link && [ -e "$lib" ]; then
  llvm-readelf -hld --dyn-syms "$lib" >"$out/elf.txt"
  grep -q 'Machine:.*AArch64' "$out/elf.txt" || fail "not an AArch64 library"
  # Exports: exactly the native methods of NativeBridge.java, less the test hook.
  sed -n 's/.*static native [][a-zA-Z]* \([a-zA-Z]*\)(.*/Java_com_flashmat_NativeBridge_\1/p' \
    "$here/flashmat/src/main/java/com/flashmat/NativeBridge.java" | grep -v '_fail$' | sort >"$out/natives.txt"
  llvm-nm -D --defined-only "$lib" | awk '{print $NF}' | sed 's/@.*//' | sort >"$out/exports.txt"
  diff "$out/natives.txt" "$out/exports.txt" || fail "the library's exports (>) are not NativeBridge's natives (<)"
  ok "exports are the $(wc -l <"$out/exports.txt") native methods, nothing else"
  needed=$(sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p' "$out/elf.txt" | sort | tr '\n' ' ')
  for library in $needed; do
    case $library in libc.so | libdl.so | libm.so | liblog.so) ;; *) fail "needs $library" ;; esac
  done
  ok "needs $needed"
  awk '/ LOAD /{n++; if ($NF != "0x4000") bad = 1} END {exit bad || !n}' "$out/elf.txt" ||
    fail "a LOAD segment is not aligned to 16 KB"
  ok "$(grep -c ' LOAD ' "$out/elf.txt") LOAD segments, all aligned to 16 KB"
  grep -q 'TEXTREL' "$out/elf.txt" && fail "has text relocations"
  llvm-strip --strip-unneeded -o "$out/libflashmat_jni.so" "$lib"
  size=$(stat -c %s "$out/libflashmat_jni.so")
  limit=$(sed -n 's/.*"arm64-v8a": *\([0-9]*\).*/\1/p' "$here/flashmat/code_size.json")
  [ "$size" -le "$limit" ] || fail "stripped library of $size bytes, code_size.json allows $limit"
  ok "stripped library of $size bytes, $limit allowed"
fi

if wanted golden && [ -x "$cargo" ]; then
  if packages qemu-user-static gcc-aarch64-linux-gnu libc6-dev-arm64-cross; then
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
    for cpu in max cortex-a53; do
      # The best level of the CPU must have run, or the tests fail.
      level=neon
      [ $cpu = max ] && level=i8mm
      export FLASHMAT_REQUIRE_LEVEL=$level
      export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64-static -cpu $cpu -L /usr/aarch64-linux-gnu"
      # The same packages both times: other features would be another build.
      tests=(test --target aarch64-unknown-linux-gnu --target-dir "$built" --locked -p flashmat-core -p flashmat-tests)
      "$cargo" "${tests[@]}" --lib -- --nocapture kernels:: net::tests
      "$cargo" "${tests[@]}" --test net_golden -- --nocapture
      ok "kernels and golden network results on aarch64 up to level $level, emulated CPU $cpu"
    done
  else
    not_run "golden: qemu and the aarch64 linker cannot be installed"
  fi
fi

android_jar() { # fetches Debian bullseye's android.jar (API 23) and dx; they are in no later release
  local apt=$tools/bullseye jar dx
  jar() { find "$apt/root" -name android.jar 2>/dev/null | head -1; }
  dx() { find "$apt/root" -name 'com.android.dx-*.jar' 2>/dev/null | head -1; }
  if [ -z "$(jar)" ] || [ -z "$(dx)" ]; then
    local mirror
    mirror=$(cat /etc/apt/sources.list /etc/apt/sources.list.d/* 2>/dev/null |
      grep -oE 'https?://[^ ]*debian/?( |$)' | head -1 | tr -d ' ')
    [ -n "$mirror" ] || return 1
    mkdir -p "$apt"/{lists/partial,archives/partial,root}
    cat >"$apt/apt.conf" <<EOF
Dir::Etc::SourceList "$apt/sources.list";
Dir::Etc::SourceParts "/dev/null";
Dir::State::Lists "$apt/lists";
Dir::State::Status "$apt/status";
Dir::Cache::Archives "$apt/archives";
Dir::Cache::pkgcache "";
Dir::Cache::srcpkgcache "";
APT::Architecture "amd64";
APT::Architectures {"amd64";};
EOF
    echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $mirror bullseye main" >"$apt/sources.list"
    : >"$apt/status"
    (cd "$apt" && export APT_CONFIG=$apt/apt.conf && apt-get update -qq &&
      apt-get download -qq dalvik-exchange libandroid-23-java) >"$out/bullseye.log" 2>&1 || return 1
    local deb
    for deb in "$apt"/*.deb; do dpkg -x "$deb" "$apt/root"; done
  fi
  [ -n "$(jar)" ] && [ -n "$(dx)" ] || return 1
  echo "$(jar) $(dx)"
}

if wanted apk; then
  if ! command -v javac >/dev/null || ! packages aapt apksigner zipalign libsmali-java; then
    not_run "apk: a JDK, aapt, apksigner and zipalign are needed"
  elif ! jars=$(android_jar); then
    not_run "apk: Debian bullseye's android.jar and dx cannot be had ($(tail -1 "$out/bullseye.log" 2>/dev/null))"
  else
    read -r jar dx <<<"$jars"
    src=$here/flashmat/src/main/java/com/flashmat
    mkdir -p "$out/classes" "$out/apk/lib/arm64-v8a" "$out/assets/flashmat" "$out/stubs"
    javac -nowarn -source 8 -target 8 -Xlint:-options -d "$out/stubs" "$here"/stubs/androidx/annotation/*.java
    # The API 26 class is replaced: this android.jar is of API 23.
    mapfile -t sources < <(find "$src" "$here/check/src" "$here/check/api26" -name '*.java' ! -path "$src/android/ColourSpaces.java")
    javac -nowarn -source 8 -target 8 -Xlint:-options -bootclasspath "$jar" -cp "$out/stubs" -d "$out/classes" "${sources[@]}"
    ok "${#sources[@]} Java sources compiled against $(basename "$(dirname "$jar")")'s android.jar"
    java -cp "$(echo "$(dirname "$dx")"/*.jar | tr ' ' ':')" com.android.dx.command.Main --dex --min-sdk-version=24 \
      --output="$out/apk/classes.dex" "$out/classes"
    [ ! -e "$out/libflashmat_jni.so" ] || cp "$out/libflashmat_jni.so" "$out/apk/lib/arm64-v8a/"
    model=models/phone.fmat
    [ -e "$model" ] || model=tests/golden/toy.fmat
    cp "$model" "$out/assets/flashmat/phone.fmat"
    aapt package -0 so -0 fmat -M "$here/check/AndroidManifest.xml" -I "$jar" -A "$out/assets" -F "$out/raw.apk" "$out/apk"
    zipalign -p 4 "$out/raw.apk" "$out/aligned.apk"
    keytool -genkeypair -keystore "$out/key.jks" -storepass android -alias check -keyalg RSA -validity 30 \
      -dname CN=check 2>/dev/null
    apksigner sign --min-sdk-version 24 --ks "$out/key.jks" --ks-pass pass:android --out "$out/check.apk" "$out/aligned.apk"
    apksigner verify --verbose --min-sdk-version 24 "$out/check.apk" | grep -E '^Verified using v[23]' | sort >"$out/verify.txt"
    grep -q 'v2 scheme.*true' "$out/verify.txt" || fail "the APK's signature does not verify"
    zipalign -c -p 4 "$out/check.apk" || fail "the APK is not aligned"
    aapt dump badging "$out/check.apk" | grep -q "launchable-activity: name='com.flashmat.check.CheckActivity'" ||
      fail "the APK has no activity"
    stored() { unzip -v "$out/check.apk" | awk -v n="$1" '$NF == n {print $2}'; }
    for file in assets/flashmat/phone.fmat lib/arm64-v8a/libflashmat_jni.so; do
      case $(stored "$file") in
        Stored) ok "APK: $file stored uncompressed" ;;
        '') not_run "APK: $file is not in it" ;;
        *) fail "APK: $file is compressed" ;;
      esac
    done
    ok "signed APK of $(stat -c %s "$out/check.apk") bytes, signature verified"
  fi
fi
echo "android/check-cross.sh: $checked checks ok"
[ "$checked" -gt 0 ] || echo "android/check-cross.sh: nothing could be run here"
