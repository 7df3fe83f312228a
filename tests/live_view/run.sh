#!/usr/bin/env bash
# run.sh RSFM_ONBOARD RSFM_TOOL RSFM_JAR WORK [PICTURE]: the daemon on simulated images, live on a bus in a network of its own, and
# lcm-spy with the SDK's types under a virtual screen: pose, status and keyframe decoded, as a picture. Exit code 77: not possible.
set -euo pipefail
onboard=$1 tool=$2 jar=$3 work=$4 picture=${5:-$4/live_view.png}
here=$(cd "$(dirname "$0")" && pwd)
skip() { echo "skipped: $1"; exit 77; }
if [[ ${RSFM_IN_NAMESPACE:-} != 1 ]]; then
  for program in Xvfb java xdotool openbox import ip unshare; do
    command -v $program >/dev/null || skip "$program is not here (packages xvfb default-jre xdotool openbox imagemagick iproute2)"
  done
  [[ -e $jar ]] || skip "$jar is not built"
  [[ -e /usr/share/java/lcm.jar && -e /usr/share/java/jchart2d.jar ]] || skip "lcm-spy is not here (packages liblcm-java libjchart2d-java)"
  unshare -n true 2>/dev/null || skip "no network namespace may be made"
  RSFM_IN_NAMESPACE=1 exec unshare -n "$0" "$@"
fi
ip link set lo up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo

url="udpm://239.255.76.67:7667?ttl=0"
rm -rf "$work"
mkdir -p "$work"
"$tool" simulate "$here/scenario.yaml" --images 14 --out "$work/made" >/dev/null 2>&1
pids=()
trap 'kill "${pids[@]}" 2>/dev/null; wait 2>/dev/null' EXIT
# Keyframes of few features: Java's socket buffer is small.
echo 'mapper: {descriptor: orb, max_features: 500}' >>"$work/made/rig.yaml"
display=:$((70 + RANDOM % 100))
export DISPLAY=$display LCM_DEFAULT_URL=$url
Xvfb $display -screen 0 1280x900x24 -nolisten tcp >/dev/null 2>&1 &
pids+=($!)
for i in $(seq 100); do xdotool getdisplaygeometry >/dev/null 2>&1 && break; sleep 0.1; done
openbox >/dev/null 2>&1 &
pids+=($!)
java -Djava.net.preferIPv4Stack=true -Dsun.java2d.xrender=false -cp "/usr/share/java/lcm.jar:/usr/share/java/jchart2d.jar:$jar" lcm.spy.Spy \
  >"$work/spy.log" 2>&1 &
pids+=($!)
window() { xdotool search --onlyvisible --name "$1" 2>/dev/null | head -n 1; }
wait_for() {  # window's name
  for i in $(seq 300); do [[ -n $(window "$1") ]] && return 0; sleep 0.2; done
  echo "FAILED: no window $1; $(cat "$work/spy.log")" >&2
  exit 1
}
wait_for '^LCM Spy$'
"$onboard" "$work/made/rig.yaml" --lcm-url "$url" --replay "$work/made" --rate 0.25 --out "$work/mission" >"$work/onboard.log" 2>&1 &
pids+=($!)
spy=$(window '^LCM Spy$')
xdotool windowmove "$spy" 0 0 windowsize "$spy" 640 300
sleep "${RSFM_SPY_SECONDS:-12}"
# The rows stand in the order in which the channels came: a double click opens what a channel's messages say.
for y in $(seq 27 16 107); do
  xdotool mousemove --window "$spy" 80 "$y" click --repeat 2 --delay 60 1
  sleep 0.7
done
sleep 9  # a keyframe or two, for the windows to show
place() {  # channel x y width height
  local id
  id=$(window "$1")
  [[ -n $id ]] || { echo "FAILED: $1 was not decoded" >&2; return 1; }
  xdotool windowmove "$id" $2 $3 windowsize "$id" $4 $5 windowraise "$id"
}
status=0
for id in $(xdotool search --onlyvisible --name '^RSFM_' 2>/dev/null); do
  name=$(xdotool getwindowname "$id")
  case $name in *RSFM_POSE* | *RSFM_STATUS* | *RSFM_KEYFRAME*) ;; *) xdotool windowminimize "$id" ;; esac
done
place RSFM_POSE 640 0 640 440 || status=1
place RSFM_STATUS 0 320 640 580 || status=1
place RSFM_KEYFRAME 640 460 640 440 || status=1
sleep 3
import -window root "$picture"
kill -INT "${pids[3]}"
wait "${pids[3]}" || status=1
grep -qi exception "$work/spy.log" && { cat "$work/spy.log" >&2; status=1; }
"$tool" info "$work/mission"
exit $status
