# In the guest, with the programs and a mission beside it: what tests/vivid/run.sh asks for.
# vivid's faults, as controls: percentage of dropped frames, one damaged buffer, a failing STREAMON, a device pulled out.
drop=0xf0f040 unplug=0xf0f041 damage=0xf0f042 refuse=0xf0f045
url="udpm://239.255.76.67:7667?ttl=0"
. ./part  # part, width
in_system() { chroot /sysroot "$@"; }
set_control() { in_system /mnt/vivid_feed set /dev/video0 $1 $2; }
say() { read -r up rest </proc/uptime; echo "guest $up s: $*"; }

play() {
  chroot /sysroot /mnt/vivid_feed play /dev/video0 /dev/video1 /mnt/mission 500 "$url" >feed.log 2>&1 &
  feed=$!
  for i in $(seq 240); do
    grep -qs playing feed.log && say "playing" && return 0
    sleep 0.5
  done
  cat feed.log
  return 1
}
stop() {
  kill -TERM $1
  wait $1
}
map() {  # in the background
  chroot /sysroot /mnt/rsfm_onboard /mnt/rig.yaml --out /mnt/out &
  onboard=$!
}

# Until the mission's log holds so many of a message; a guest on a busy machine takes its time.
number() { grep -ao $1 out/events.lcm 2>/dev/null | wc -l; }
wait_for() {  # message, number
  for i in $(seq 240); do
    [ "$(number $1)" -ge $2 ] && say "$2 $1" && return 0
    sleep 1
  done
  echo "only $(number $1) $1"
  return 1
}
wait_for_poses() { wait_for RSFM_POSE $1; }

say "$(ls /dev/video* | tr '\n' ' ')"
play || exit 1
if [ $part = capture ]; then
  in_system /mnt/vivid_feed grab /dev/video0 /mnt/mission 10 || exit 1
  map
  wait_for_poses 8 || exit 1
else
  map
  wait_for_poses 3 || exit 1
  set_control $drop 50
  sleep 2
  set_control $drop 0
  for i in 1 2 3; do
    set_control $damage 1
    sleep 0.5
  done
  set_control $refuse 1
  set_control $unplug 1
  for i in $(seq 60); do
    grep -q "open 2" feed.log && break
    sleep 0.5
  done
  say "plugged in again"
  wait_for_poses $(($(number RSFM_POSE) + 3)) || exit 1
  wait_for RSFM_STATUS $(($(number RSFM_STATUS) + 2)) || exit 1
fi
stop $onboard || exit 1
stop $feed
say "done"
cat feed.log
exit 0
