#!/usr/bin/env bash
# steps.sh SOURCE WORK: runs copies of .ci/run and tools/test with stand-ins for every program that they call. Of each preset a file in
# $WORK/does says what its tests do: fail, crash, hang (the time is up while they run), fail_hang (one has failed before), run_on (for
# ever); without one they pass.
set -euo pipefail
source=$1 work=$2
rm -rf "$work"
mkdir -p "$work"/{tools,.ci,toolchains,bin,does}
cp "$source/tools/test" "$work/tools/"
cp "$source/.ci/run" "$work/.ci/"
cd "$work"
export PATH=$work/bin:$PATH DOES=$work/does

stand_in() { printf '#!/usr/bin/env bash\n%s\n' "$2" >"$1"; chmod +x "$1"; }
stand_in tools/install_dependencies ''
# shellcheck disable=SC2016
stand_in toolchains/make_sysroot.sh '[[ ! -e $DOES/no_network ]] || { echo "no network" >&2; exit 1; }; mkdir -p "build/sysroot-$2"'
for program in mmdebstrap aarch64-linux-gnu-g++ arm-linux-gnueabihf-g++ qemu-aarch64 qemu-arm qemu-system-aarch64 g++-11 clang++; do
  stand_in "bin/$program" ''
done
# shellcheck disable=SC2016
stand_in bin/cmake '[[ $1 != --build || ! -e $DOES/not_compile-$3 ]] || { echo "error: no compilation"; exit 1; }'
# shellcheck disable=SC2016
stand_in bin/ctest 'time_is_up() {  # timeout takes this signal for its own alarm
  local pid=$PPID
  until [[ $(<"/proc/$pid/comm") == timeout ]]; do pid=$(cut -d " " -f 4 "/proc/$pid/stat"); done
  kill -ALRM "$pid"
  exec sleep 100000
}
case $(cat "$DOES/$2" 2>/dev/null) in
  run_on) echo $$ >"$DOES/pid"; exec sleep 100000 ;;
  fail) echo "1/2 Test #1: A ....***Failed 0.01 sec"; exit 8 ;;
  crash) echo "1/2 Test #1: A ....***Exception: SegFault 0.01 sec"; exit 8 ;;
  hang) time_is_up ;;
  fail_hang)
    echo "1/2 Test #1: A ....***Failed 0.01 sec"
    until grep -q Failed build/test-step.log; do sleep 0.01; done
    time_is_up ;;
esac'

# run_ci NAME EXIT_CODE: with what is in does/; its output is in out.
run_ci() {
  local status=0
  rm -rf build
  .ci/run >out 2>&1 || status=$?
  ((status == $2)) || { cat out; echo "FAILED: $1: exit code $status, not $2" >&2; exit 1; }
  rm -f does/*
}
says() { grep -qF -- "$1" out || { cat out; echo "FAILED: it does not say: $1" >&2; exit 1; }; }
says_not() { ! grep -qF -- "$1" out || { cat out; echo "FAILED: it says: $1" >&2; exit 1; }; }

run_ci "all well" 0
says "== aarch64: the tests of sdk and drivers, the packages: 0 min"
says "== thread sanitizer: 0 min"  # 60 minutes are expected of it: tried because there is time
says_not "left out"
says_not "FAILED"

echo fail >does/dev
run_ci "the tests fail" 1
says_not "== fuzzers"

for preset in aarch64 armhf asan-ubsan tsan; do
  echo fail >"does/$preset"
  run_ci "$preset fails" 1
  says "FAILED: "
  says "== thread sanitizer"  # the others run all the same
done
echo crash >does/tsan
run_ci "a test of the thread sanitizer crashes" 1
touch does/not_compile-gcc11
run_ci "GCC 11 does not compile it" 1
says "FAILED: gcc11: what the vehicle runs, built by GCC 11"

echo fail >does/fuzz
run_ci "a fuzzer finds something" 0
says "FAILED, perhaps by chance: fuzz: fuzzers, a minute each"
says "a release must pass it"
echo fail >does/fuzz
echo fail >does/tsan
run_ci "a fuzzer finds something and a test fails" 1

touch does/no_network
run_ci "there is no sysroot" 0
says "left out: aarch64: the tests of sdk and drivers, the packages (not possible here)"
says "left out: 32-bit ARM: the daemon, its package, tests of files, messages and ports (not possible here)"
says_not "FAILED"

echo hang >does/aarch64
run_ci "a step does not end" 0
says "left out: aarch64: the tests of sdk and drivers, the packages (ended after"
says "== thread sanitizer"
says_not "FAILED"
echo fail_hang >does/aarch64
run_ci "a step does not end, and a test has failed" 1
says "FAILED: cross: aarch64"
echo hang >does/dev
run_ci "the tests do not end" 1
says "error: the tests did not end in 64 minutes"

# shellcheck disable=SC2065
tools/test --full --minutes 1 --only 'gcc11 thread' >out
says "left out: thread sanitizer (no time left)"
says_not "== thread sanitizer"

# Who ends it ends what it runs.
rm -f does/*
echo run_on >does/aarch64
.ci/run >out 2>&1 &
ci=$!
until [[ -s does/pid ]]; do sleep 0.01; done
kill -TERM $ci
status=0
wait $ci || status=$?
((status != 0)) || { echo "FAILED: it was ended, and says that all is well" >&2; exit 1; }
while kill -0 "$(<does/pid)" 2>/dev/null; do sleep 0.01; done
