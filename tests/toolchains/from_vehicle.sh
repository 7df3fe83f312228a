#!/usr/bin/env bash
# from_vehicle.sh SOURCE SYSROOT TOOLCHAIN ARCH TRIPLET RSFM_ONBOARD WORK: a vehicle's file system, made from a part of the sysroot, whose
# package of libturbojpeg has Ubuntu's name, is copied by make_sysroot.sh --from. A program builds against the copy and runs, no link leads
# out of it, and what rsfm_onboard depends on has the vehicle's names.
set -euo pipefail
source=$1 sysroot=$2 toolchain=$3 arch=$4 triplet=$5 onboard=$6 work=$7
fail() { echo "FAILED: $1" >&2; exit 1; }
compgen -G "$sysroot/var/lib/dpkg/info/*.list" >/dev/null || { echo "skipped: $sysroot has no package data base: make it again"; exit 77; }
rm -rf "$work"
vehicle=$work/vehicle copy=$work/sysroot

# The C and C++ libraries, libturbojpeg, and every library that rsfm_onboard asks for, as a vehicle has them: lib is usr/lib, some links
# are absolute, a library of its own lies where only ld.so.conf.d says, and the disk holds things that no compiler needs.
mkdir -p "$vehicle"/{usr/lib/"$triplet",usr/include,usr/share/cmake,usr/bin,home/user,etc/ld.so.conf.d,var/lib/dpkg/info}
ln -s usr/lib "$vehicle/lib"
lib=$sysroot/usr/lib/$triplet
cp -a "$sysroot/usr/include/"{"$triplet",c++,linux,asm-generic,turbojpeg.h,stdc-predef.h,features.h,features-time64.h} "$vehicle/usr/include/"
cp -a "$sysroot"/usr/include/*.h "$vehicle/usr/include/"
cp -a "$sysroot/usr/lib/gcc" "$vehicle/usr/lib/"
for folder in "$lib" "$sysroot/lib/$triplet"; do
  find "$folder/" -maxdepth 1 \( -name '*crt*.o' -o -name 'libc[.-]*' -o -name 'libc_nonshared*' -o -name 'libm[.-]*' -o -name 'libmvec*' -o -name 'ld-linux*' \
    -o -name 'libgcc_s*' -o -name 'libstdc++*' -o -name 'libturbojpeg*' -o -name 'libopencv_*.so*' -o -name 'liblcm*' -o -name 'libGeographic*' \
    -o -name 'libyaml-cpp*' \) -exec cp -a -t "$vehicle/usr/lib/$triplet" {} +
done
find "$sysroot/lib/" -maxdepth 1 -name 'ld-linux*' -exec cp -aL -t "$vehicle/usr/lib" {} +
ln -sfn "/usr/lib/$triplet/libturbojpeg.so.0" "$vehicle/usr/lib/$triplet/libturbojpeg.so"
mkdir "$vehicle/usr/lib/$triplet/own"
mv "$vehicle/usr/lib/$triplet"/liblcm.so.* "$vehicle/usr/lib/$triplet/own/"
echo "/usr/lib/$triplet/own" >"$vehicle/etc/ld.so.conf.d/own.conf"
echo secret >"$vehicle/home/user/diary"
printf 'set_target_properties(x PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "/usr/include/x")\n' >"$vehicle/usr/share/cmake/x.cmake"
info=$vehicle/var/lib/dpkg/info
cp -a "$sysroot"/var/lib/dpkg/info/*.{list,shlibs,symbols} "$info/"
echo "echo a maintainer\'s script" >"$info/libturbojpeg.postinst"
for kind in list shlibs symbols; do
  mv "$info"/libturbojpeg0:*."$kind" "$info/libturbojpeg:$arch.$kind"
done
sed -i -e 's/ libturbojpeg0 (>= .*)/ libturbojpeg (>= 2.1.2)/' "$info/libturbojpeg:$arch.shlibs"
sed -i -e "s,/liblcm\.so,/own&," "$info"/liblcm1*.list
sed -e 's/^Package: libturbojpeg0$/Package: libturbojpeg/' "$sysroot/var/lib/dpkg/status" >"$vehicle/var/lib/dpkg/status"

made=$("$source/toolchains/make_sysroot.sh" --from "$vehicle" --arch "$arch" "$copy")
[[ $made == "$copy" ]] || fail "make_sysroot.sh printed $made"
if "$source/toolchains/make_sysroot.sh" --from "$vehicle" --arch "$arch" "$copy" >/dev/null 2>&1; then fail "it overwrote a sysroot"; fi
if "$source/toolchains/make_sysroot.sh" --from "$work" --arch "$arch" "$work/none" >/dev/null 2>&1; then fail "a folder without usr/lib was copied"; fi
[[ ! -e $work/none ]] || fail "it left half a sysroot"
[[ ! -e $copy/home && ! -e $copy/usr/bin ]] || fail "it copied what no compiler needs"
[[ ! -e $copy/var/lib/dpkg/info/libturbojpeg.postinst ]] || fail "it copied a maintainer's script"
[[ -s $copy/var/lib/dpkg/status ]] || fail "it left the package data base behind"
absolute=$(find "$copy" -type l -lname '/*')
[[ -z $absolute ]] || fail "absolute links: $absolute"
grep -qF '"${CMAKE_SYSROOT}/usr/include/x"' "$copy/usr/share/cmake/x.cmake" || fail "an exported target leads out of the sysroot"

mkdir "$work/program"
cat >"$work/program/CMakeLists.txt" <<'CMAKE'
cmake_minimum_required(VERSION 3.22)
project(program CXX)
find_library(TURBOJPEG turbojpeg REQUIRED)
add_executable(program main.cc)
target_link_libraries(program ${TURBOJPEG})
enable_testing()
add_test(NAME program COMMAND program)
CMAKE
cat >"$work/program/main.cc" <<'CODE'
#include <turbojpeg.h>
#include <iostream>
#include <string>
int main() {
  tjhandle encoder = tjInitCompress();
  std::cout << std::string(encoder ? "encodes" : "does not") << '\n';
  return tjDestroy(encoder);
}
CODE
RSFM_SYSROOT=$copy cmake -G Ninja -S "$work/program" -B "$work/program/build" -DCMAKE_TOOLCHAIN_FILE="$toolchain" >"$work/log" 2>&1 &&
  cmake --build "$work/program/build" >>"$work/log" 2>&1 || { tail -n 30 "$work/log" >&2; fail "nothing builds against the copy"; }
grep -q "^TURBOJPEG:FILEPATH=$copy/" "$work/program/build/CMakeCache.txt" || fail "the library that was found is not the copy's"
if grep -q '^RSFM_EMULATOR:FILEPATH=.*NOTFOUND' "$work/program/build/CMakeCache.txt"; then
  echo "no emulator: the program is not run"
else
  (cd "$work/program/build" && ctest --output-on-failure >>"$work/log" 2>&1) || { tail -n 30 "$work/log" >&2; fail "the program does not run"; }
fi

cat >"$work/depends.cmake" <<CMAKE
include($source/cmake/shared_objects.cmake)
rsfm_depends("$copy" $triplet $onboard depends)
message("\${depends}")
CMAKE
depends=$(cmake -P "$work/depends.cmake" 2>&1)
echo "$depends"
for name in 'libturbojpeg (>= 2.1.2)' 'libc6 (>= ' liblcm1 libyaml-cpp; do
  [[ $depends == *"$name"* ]] || fail "rsfm_onboard does not depend on $name by the vehicle's names, but on: $depends"
done
[[ $depends != *libturbojpeg0* ]] || fail "Debian's name of libturbojpeg, not the vehicle's: $depends"
rm -rf "$vehicle" "$copy"
