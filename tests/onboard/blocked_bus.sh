#!/usr/bin/env bash
# blocked_bus.sh RSFM_ONBOARD RSFM_TOOL SCENARIO WORK: the daemon in a network that drops incoming multicast, as a firewall would, until
# it no longer does: it maps, says that it hears no navigation, and hears it in the end. Exit code 77: not possible here.
set -euo pipefail
onboard=$1 tool=$2 scenario=$3 work=$4
skip() { echo "skipped: $1"; exit 77; }
if [[ ${RSFM_IN_NAMESPACE:-} != 1 ]]; then
  for program in ip unshare lcm-logplayer; do command -v $program >/dev/null || skip "$program is not here (packages iproute2 liblcm-bin)"; done
  unshare -rn true 2>/dev/null || skip "no network namespace may be made"
  RSFM_IN_NAMESPACE=1 exec unshare -rn "$0" "$@"
fi
ip link set lo up multicast on
ip route add 224.0.0.0/4 dev lo
{ echo 0 >/proc/sys/net/ipv4/conf/lo/disable_policy; } 2>/dev/null || skip "the network's policies may not be changed"
policy=(src 0.0.0.0/0 dst 239.0.0.0/8 dir in)
ip xfrm policy add "${policy[@]}" action block 2>/dev/null || skip "the kernel knows no policies (xfrm)"

rm -rf "$work"
mkdir -p "$work"
"$tool" simulate "$scenario" --images 6 --out "$work/made" >/dev/null 2>&1
cp "$work/made/events.lcm" "$work/nav.lcm"  # the navigation's messages
rm "$work/made/nav.csv"
url="udpm://239.255.76.67:7667?ttl=0"
"$onboard" "$work/made/rig.yaml" --lcm-url "$url" --replay "$work/made" --rate 0.02 --out "$work/mission" 2>"$work/log" &
daemon=$!
trap 'kill $daemon 2>/dev/null || true' EXIT
alive() { kill -0 $daemon 2>/dev/null || { echo "FAILED: the daemon has ended"; cat "$work/log"; exit 1; }; }
until grep -aqs "no navigation is heard" "$work/mission/events.lcm"; do
  alive
  sleep 0.2
done
ip xfrm policy delete "${policy[@]}"
# Heard as soon as the daemon tries again: then the mission has it.
until grep -aq RSFM_DVL "$work/mission/events.lcm"; do
  alive
  lcm-logplayer --lcm-url="$url" --speed=20 "$work/nav.lcm" >/dev/null 2>&1
done
kill -TERM $daemon
wait $daemon || { echo "FAILED: exit code $?"; cat "$work/log"; exit 1; }
"$tool" info "$work/mission"
