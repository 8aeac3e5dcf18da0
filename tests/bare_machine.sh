#!/bin/sh
# What the README promises a newcomer, on a machine that has python3 and git and nothing else: a bare
# Debian, made by debootstrap in a temporary folder, and in it ./run demo and ./run test on a fresh
# clone of this commit. Needs root, a Debian or Ubuntu, 4 GB of disk, and apt and PyPI within reach.
#
#   tests/bare_machine.sh SUITE CASE     SUITE is bookworm or trixie; CASE is one of
#       root       as root; ./run installs what is missing
#       root-egl   as root, where the libraries to render with are already there
#       sudo       as a user whose sudo asks for no password
#       user       as a user without sudo: ./run ends with 2 and says what is missing, until it is there
#   tests/bare_machine.sh wheel PYTHON   the wheel, by plain pip, in an empty environment of PYTHON
set -eu
export LC_ALL=C.UTF-8
repo=$(cd "$(dirname "$0")/.." && pwd)
certificates=/etc/ssl/certs/ca-certificates.crt

say() { echo "bare_machine: $*"; }
fail() { echo "bare_machine: $*" >&2 && exit 1; }
usage() { sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2 && exit 2; }

# timed WHAT COMMAND...: runs it, and says how long it took.
timed() {
    what=$1 began=$(date +%s)
    shift
    "$@" || fail "$label: $what failed"
    say "$label: $what: $(($(date +%s) - began)) s"
}

# mb PATH...: megabytes on disk, 0 where nothing is there.
mb() { du -skc "$@" 2>/dev/null | awk 'END { printf "%.0f", $1 / 1024 }'; }

# pip_mb LOG: megabytes that pip says it downloaded.
pip_mb() {
    awk 'BEGIN { unit["bytes)"] = 1e-6; unit["kB)"] = 1e-3; unit["MB)"] = 1; unit["GB)"] = 1e3 }
        / Downloading / && $NF in unit { n += substr($(NF - 1), 2) * unit[$NF] }
        END { printf "%.0f", n }' "$1"
}

# apart PROC COMMAND...: with mounts and processes of its own, which end with it even when it is killed.
apart() {
    proc=$1
    shift
    unshare --mount --pid --fork --kill-child --mount-proc="$proc" "$@"
}

# inside WHO COMMAND...: runs it in the bare machine, in the clone, with nothing of our environment but
# what leads to PyPI.
inside() {
    as=$1
    shift
    # shellcheck disable=SC2016
    apart "$root/proc" chroot --userspec="$as" "$root" env -i HOME="$home" LC_ALL=C.UTF-8 \
        PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        sh -c '. /etc/way_out.sh && cd "$HOME/endolock" && exec "$@"' sh "$@"
}

install() {
    inside root apt-get update -qq &&
        inside root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# way_out HOME: what of our environment leads to PyPI, and no more.
way_out() {
    echo "export PIP_PROGRESS_BAR=off PIP_CERT=$certificates PIP_LOG=$1/pip.log"
    export -p | grep -iE '^export (PIP_((EXTRA_)?INDEX_URL|PROXY|TRUSTED_HOST|DEFAULT_TIMEOUT)|[a-z]+_PROXY)=' || true
}

bare_root() {
    mirror=$(apt-get indextargets --format "\$(REPO_URI)" "Origin: Debian" "Label: Debian" | head -n 1)
    # shellcheck disable=SC2086
    apart /proc debootstrap --variant=minbase --include="$packages" "$suite" "$root" $mirror >"$work/log" 2>&1 ||
        { tail -n 20 "$root/debootstrap/debootstrap.log" && return 1; }
    rm -rf "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/*
    cp /etc/resolv.conf /etc/hosts "$root/etc/"
    cp "$certificates" "$root$certificates"
    [ ! -e /etc/pip.conf ] || cp /etc/pip.conf "$root/etc/"
    apt-config dump Acquire | grep -v IndexTargets >"$root/etc/apt/apt.conf.d/way_out"
    way_out "$home" >"$root/etc/way_out.sh"
    chmod 1777 "$root/dev/shm" # as where it is mounted
    [ "$who" = root ] || chroot "$root" useradd --create-home --shell /bin/sh "$who"
    [ "$case" != sudo ] || printf '%s\n' 'Defaults env_keep += "http_proxy https_proxy no_proxy"' \
        "$who ALL=(ALL) NOPASSWD: ALL" >"$root/etc/sudoers.d/$who"
    git clone -q "$repo" "$clone"
    chroot "$root" chown -R "$who:" "$home"
}

# refused PACKAGE...: ./run demo must end with 2 and say that these are missing.
refused() {
    code=0
    inside "$who" ./run demo >"$work/log" 2>&1 || code=$?
    sed 's/^/    /' "$work/log"
    [ "$code" = 2 ] && grep -q "could not install $*" "$work/log"
}

# shellcheck disable=SC2016
installed_mb() { chroot "$root" dpkg-query -W -f '${Installed-Size}\n' | awk '{ n += $1 } END { printf "%.0f", n / 1024 }'; }

bare() {
    who=root home=/root packages=python3,git,ca-certificates
    case $case in
    root) ;;
    root-egl) packages=$packages,libegl1,libgl1 ;;
    sudo) who=tester home=/home/tester packages=$packages,sudo ;;
    user) who=tester home=/home/tester ;;
    *) usage ;;
    esac
    [ "$(id -u)" = 0 ] || fail "needs root to make a bare machine; run it as root, or through sudo"
    command -v debootstrap >/dev/null || { apt-get update -qq && apt-get install -y -qq debootstrap; } >"$work/log" 2>&1 ||
        fail "needs debootstrap, and apt-get could not install it; install it, then run this again"
    root=$work/root clone=$work/root$home/endolock
    mkdir -p "$root/proc"

    timed "bare machine" bare_root
    before=$(installed_mb)
    say "$label: bare machine: $before MB, $(chroot "$root" python3 -V)"
    if [ "$case" = user ]; then
        timed "./run demo, refused" refused python3-venv
        [ ! -e "$clone/.venv" ] || fail "$label: ./run left something behind"
        timed "an administrator installs python3-venv" install python3-venv
        timed "./run demo, refused" refused libegl1 libgl1
        timed "a run without pictures" inside "$who" ./run endolock run rest --vision truth --duration-s 2
        timed "an administrator installs libegl1 libgl1" install libegl1 libgl1
    fi
    timed "./run demo" inside "$who" ./run demo
    timed "./run test" inside "$who" ./run test
    say "$label: downloaded: $(mb "$root/var/lib/apt/lists") MB package lists," \
        "$(mb "$root"/var/cache/apt/archives/*.deb) MB packages, $(pip_mb "$root$home/pip.log") MB by pip"
    say "$label: installed: $(($(installed_mb) - before)) MB packages, $(mb "$clone/.venv") MB .venv"
}

# plainly COMMAND...: runs it with nothing of our environment or settings but what leads to PyPI.
plainly() {
    # shellcheck disable=SC2016
    env -i HOME="$work" PATH="$PATH" LC_ALL=C.UTF-8 sh -c '. "$HOME/way_out.sh" && exec "$@"' sh "$@"
}

build_wheel() {
    plainly "$python" -m venv "$work/build"
    plainly "$work/build/bin/pip" install -q build
    git clone -q "$repo" "$work/clone"
    plainly "$work/build/bin/python" -m build --wheel --outdir "$work" "$work/clone" >"$work/log" 2>&1 ||
        { tail -n 20 "$work/log" && return 1; }
    rm -rf "$work/clone" "$work/pip.log"
}

wheel() {
    python=$("$1" -c 'import sys; print(sys.executable)') || fail "$1 does not run; give a Python of 3.11 or newer"
    label="wheel $("$python" -V)"
    cd "$work"
    way_out "$work" >way_out.sh
    timed "wheel built" build_wheel
    plainly "$python" -m venv site
    timed "wheel and its dependencies installed" plainly site/bin/pip install -q endolock-*.whl
    say "$label: downloaded: $(pip_mb pip.log) MB by pip; installed: $(mb site) MB of environment"
    plainly site/bin/python -c 'import endolock, pathlib
folder = pathlib.Path(endolock.__file__).parent
assert folder.is_relative_to(pathlib.Path("site").resolve()), folder
print(*sorted(str(f.relative_to(folder)) for f in folder.glob("models/**/*.*ml")))'
    timed "run without pictures" plainly site/bin/endolock run rest --vision truth --duration-s 2 --out truth
    timed "run with pictures" plainly site/bin/endolock run rest --duration-s 2 --out pictures
}

[ $# = 2 ] || usage
label="$1 $2" case=$2
work=$(mktemp -d "${TMPDIR:-/tmp}/bare_machine.XXXXXX")
trap 'rm -rf --one-file-system "$work"' EXIT
trap 'exit 143' HUP INT TERM
case $1 in
bookworm | trixie) suite=$1 && bare ;;
wheel) wheel "$2" ;;
*) usage ;;
esac
say "$label: passed"
