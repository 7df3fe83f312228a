#!/usr/bin/env bash
# run.sh BUILD SYSROOT RSFM_TOOL WORK PART: the cross-compiled rsfm_onboard on the kernel's own video driver, in an aarch64 guest.
# PART: 640x480 | 1280x720 (a mission in that size) | faults. The host's rsfm_tool makes the mission that is seen and reads what came
# home. Exit code 77: not possible here, or not in RSFM_GUEST_SECONDS.
set -euo pipefail
build=$1 sysroot=$2 tool=$3 work=$4/$5 part=$5
here=$(cd "$(dirname "$0")" && pwd)
skip() { echo "skipped: $1"; exit 77; }
command -v qemu-system-aarch64 >/dev/null || skip "qemu-system-aarch64 is not here (package qemu-system-arm)"
[[ -x $tool ]] || skip "$tool is not built"
"$here/prepare_guest.sh" "$build/vivid-guest" || skip "the guest's kernel could not be fetched"

case $part in
  faults) size=640x480 kind=faults ;;
  *) size=$part kind=capture ;;
esac
width=${size%x*} height=${size#*x}
share=$work/share out=$work/share/out
rm -rf "$work"
mkdir -p "$share"
sed "s/@WIDTH@/$width/; s/@HEIGHT@/$height/; s/@CX@/$((width / 2))/; s/@CY@/$((height / 2))/; s/@F@/$((width * 4 / 5))/g" \
  "$here/scenario.yaml" >"$work/scenario.yaml"
"$tool" simulate "$work/scenario.yaml" --images 8 --out "$share/mission" >/dev/null 2>&1
cp "$build/tools/onboard/rsfm_onboard" "$build/tests/vivid/vivid_feed" "$here/job.sh" "$share/"
echo "part=$kind width=$width" >"$share/part"
# As little work for each image as makes a map: every instruction is emulated.
cat "$share/mission/rig.yaml" - >"$share/rig.yaml" <<'RIG'
capture: {device: /dev/video0, format: grey}
mapper: {descriptor: orb, max_features: 400, ransac_iterations: 200, match_keyframes: 3, window_keyframes: 3, window_landmarks: 400,
         window_iterations: 3}
onboard: {record_every: 20, min_disk_free_mb: 0}
RIG

# The guest's clock counts instructions, 2 ns each: it sees the same machine however busy this one is.
status=0
timeout --foreground "${RSFM_GUEST_SECONDS:-1500}" qemu-system-aarch64 -M virt -accel tcg,thread=single -icount shift=1 -cpu cortex-a57 -m 1024 -smp 1 \
  -nographic -no-reboot -nodefaults -serial mon:stdio -kernel "$build/vivid-guest/vmlinuz" -initrd "$build/vivid-guest/initrd" \
  -append "console=ttyAMA0 quiet panic=-1 loglevel=1" \
  -virtfs "local,path=$share,mount_tag=share,security_model=none,multidevs=remap" \
  -virtfs "local,path=$sysroot,mount_tag=sysroot,security_model=none,readonly=on,multidevs=remap" </dev/null >"$work/console.log" ||
  status=$?
cat "$work/console.log"
# The job's own waits end after 4 minutes of the guest's clock: what lasts longer is a machine that is too busy.
((status != 124)) || skip "the guest was ended: more than ${RSFM_GUEST_SECONDS:-1500} s on this machine"

failures=0
check() {  # what, condition
  if (($2)); then echo "ok      $1"; else echo "FAILED  $1" >&2; failures=$((failures + 1)); fi
}
"$tool" info "$out" >"$work/info.txt" || check "rsfm_tool info reads the mission" 0
cat "$work/info.txt"
# number PATTERN: what \( \) of the pattern holds in the first line of the mission's description that has it; 0 when none has.
number() { local found; found=$(sed -n "s/.*$1.*/\1/p" "$work/info.txt" | head -n 1); echo "${found:-0}"; }
check "the guest's job ended well" "$(cat "$share/job.rc" 2>/dev/null || echo 1) == 0"
check "poses" "$(number 'poses  *\([0-9]*\),') >= 6"
check "tracked" "$(number 'of which \([0-9]*\) tracked') >= 3"
check "keyframes" "$(number 'keyframes  *\([0-9]*\)') >= 2"
check "navigation" "$(number 'navigation  *\([0-9]*\) samples') >= 30"
check "the scale is navigation's" "$(grep -c 'scale not known' "$work/info.txt" || true) == 0"
check "log undamaged" "$(grep -c '^damage *none' "$work/info.txt") == 1"
check "images recorded" "$(find "$out/images" -name '*.jpg' | wc -l) >= 1"
if [[ $kind == capture ]]; then
  check "every pixel passed vivid unchanged" "$(grep -c 'grabbed 10, exact 10' "$work/console.log" || true) == 1"
else
  check "dropped frames were counted" "$(number '[ ,]\([0-9]*\) missed') >= 5"
  check "damaged frames were counted" "$(number '[ ,]\([0-9]*\) damaged') >= 1"
  check "the camera came back and was opened again" "$(number '[ ,]\([0-9]*\) camera restarts') >= 1"
fi
((failures == 0))
