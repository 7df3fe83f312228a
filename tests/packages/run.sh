#!/usr/bin/env bash
# run.sh BUILD WORK VERSION [SYSROOT EMULATOR…]: makes the packages of a build, installs them with dpkg into an empty root folder with a data
# base of its own, runs the programs there, and removes them. For another machine SYSROOT is its system and EMULATOR runs its programs.
set -euo pipefail
build=$1 work=$2 version=$3 sysroot=
shift 3
if (($#)); then sysroot=$1; shift; fi
fail() { echo "FAILED: $1" >&2; exit 1; }
command -v dpkg >/dev/null || { echo "skipped: dpkg is not here"; exit 77; }
rm -rf "$work"
mkdir -p "$work/packages" "$work/root/var/lib/dpkg"/{info,updates,triggers,parts}
: >"$work/root/var/lib/dpkg/status"
(cd "$work" && cpack --config "$build/CPackConfig.cmake" -B "$work/packages" >"$work/cpack.log" 2>&1) || { tail -n 30 "$work/cpack.log" >&2; fail cpack; }
debs=("$work"/packages/*.deb)
for deb in "${debs[@]}"; do
  name=$(dpkg-deb -f "$deb" Package)
  [[ $(dpkg-deb -f "$deb" Version) == "$version"* ]] || fail "$name has the wrong version"
  [[ -n $(dpkg-deb -f "$deb" Depends) ]] || fail "$name depends on nothing"
  echo "$name $(dpkg-deb -f "$deb" Architecture), $(($(stat -c %s "$deb") / 1024)) kB, depends on $(dpkg-deb -f "$deb" Depends)"
  # Everything it depends on is a package that the system it is for knows: this one, or the sysroot's data base.
  if (($#)) && [[ ! -s $sysroot/var/lib/dpkg/status ]]; then echo "the sysroot has no package data base: dependencies are not checked"; continue; fi
  dpkg-deb -f "$deb" Depends | tr ',' '\n' | while read -r alternatives; do
    known=
    for package in $(sed -e 's/([^)]*)//g' -e 's/|/ /g' <<<"$alternatives"); do
      if dpkg-query ${1:+--admindir="$sysroot/var/lib/dpkg"} -W "$package" >/dev/null 2>&1; then known=1; fi
    done
    [[ -n $known ]] || fail "$name depends on $alternatives, which is not there"
  done
  if [[ $name == rsfm-onboard ]]; then
    [[ $(dpkg-deb -f "$deb" Depends) == *'libc6 (>= '* ]] || fail "$name does not say which C library is old enough for it"
  fi
done
in_root() {
  dpkg --root="$work/root" --force-depends --force-architecture --force-script-chrootless --force-not-root --force-bad-path --log=/dev/null "$@" \
    >>"$work/dpkg.log" 2>&1 || { tail -n 20 "$work/dpkg.log" >&2; fail "dpkg $*"; }
}
in_root --install "${debs[@]}"

onboard=$work/root/usr/bin/rsfm_onboard
[[ $("$@" "$onboard" --version) == "$version" ]] || fail "rsfm_onboard --version"
[[ ! -e $work/root/usr/bin/rsfm_tool ]] || "$@" "$work/root/usr/bin/rsfm_tool" --help >/dev/null || fail "rsfm_tool --help"
unit=$work/root/usr/lib/systemd/system/rsfm-onboard.service
grep -q '^ExecStart=/usr/bin/rsfm_onboard /etc/rsfm/rig.yaml$' "$unit" || fail "the unit does not start /usr/bin/rsfm_onboard"
for file in usr/lib/udev/rules.d/60-rsfm-camera.rules usr/share/doc/rsfm-onboard/{onboard,rig,messages}.md usr/include/rsfm/mapping/incremental_mapper.h \
  usr/share/rsfm/messages/pose_t.lcm; do
  [[ -e $work/root/$file ]] || fail "$file is not installed"
done

# A mission of three grey images, without navigation: read, mapped, written.
mkdir -p "$work/images"
cat >"$work/rig.yaml" <<'RIG'
camera: {model: PINHOLE, width: 64, height: 48, params: [60, 60, 32, 24]}
port: {type: flat, normal: [0, 0, 1], distance_m: 0.02, thickness_m: 0.01, index_air: 1.0, index_glass: 1.5, index_water: 1.33}
RIG
for i in 0 1 2; do
  { printf 'P5\n64 48\n255\n'; head -c 3072 /dev/zero; } >"$work/images/$i.pgm"
done
"$@" "$onboard" "$work/rig.yaml" --lcm-url memq:// --replay "$work/images" --rate 0 --out "$work/mission" || fail "the installed rsfm_onboard"
[[ -s $work/mission/events.lcm ]] || fail "no mission was written"

in_root --purge rsfm-onboard librsfm-dev
[[ ! -e $onboard ]] || fail "purging left the program"
echo "installed, run and removed: ${#debs[@]} packages"
