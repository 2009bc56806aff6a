# Sourced by the other scripts: makes .venv with the extras named in $1 and puts it on PATH.
# Does nothing when these, or more, were installed already by this pyproject.toml and
# constraints.txt: the stamp in .venv holds their checksum, and then a line for each extra.

repo=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

find_python() { # $1: a command that must hold of it
  local candidate
  for candidate in "${PYTHON:-}" python3.14 python3.13 python3.12 python3.11 python3 ${1:+/usr/bin/python3}; do
    [ -n "$candidate" ] && command -v "$candidate" >/dev/null && "${1:-true}" "$candidate" || continue
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
  echo "teleop-rt needs Python 3.11 or newer; install it (Debian 12, Ubuntu 24.04 and later: apt install python3 python3-venv) and run this again." >&2
  return 1
}

installed() { # $1: the stamp, $2: the checksum, $3: the extras
  local stamp extra
  stamp=$(cat "$1" 2>/dev/null)
  [ "${stamp%%$'\n'*}" = "$2" ] || return 1
  for extra in ${3//,/ }; do
    case "$stamp"$'\n' in *$'\n'"$extra"$'\n'*) ;; *) return 1 ;; esac
  done
}

phase() { # $1: what is done; then the command, whose output goes to the log
  local name=$1 begun=${EPOCHREALTIME//[!0-9]/} ended tenths
  shift
  printf '%s ... ' "$name" >&2
  if ! "$@" >>"$log" 2>&1; then
    echo "failed; $log says why" >&2
    return 1
  fi
  ended=${EPOCHREALTIME//[!0-9]/}
  tenths=$(((ended - begun + 50000) / 100000))
  echo "$((tenths / 10)).$((tenths % 10)) s" >&2
}

make_environment() { # $1: the Python to make it of
  uv venv --quiet --seed --allow-existing --python "$1" "$repo/.venv" || "$1" -m venv "$repo/.venv"
}

# Where uv is missing, pip installs it into .venv from the same index.
find_uv() { # prints the command
  command -v uv && return
  [ -x "$repo/.venv/bin/uv" ] || "$repo/.venv/bin/python" -m pip install \
    --disable-pip-version-check --no-compile --constraint "$repo/constraints.txt" uv >&2 || return 1
  echo "$repo/.venv/bin/uv"
}

# uv installs in a tenth of pip's time; where it cannot be had or fails (it reads none of pip's
# settings), pip does the same. Neither compiles all modules of all packages, most of which no trial
# imports.
install_packages() { # $1: the extras
  local uv wanted=(--constraint "$repo/constraints.txt" --editable "$repo[$1]")
  uv=$(find_uv) && "$uv" pip install --python "$repo/.venv/bin/python" "${wanted[@]}" ||
    "$repo/.venv/bin/python" -m pip install --disable-pip-version-check --no-compile "${wanted[@]}"
}

what_a_run_loads='import teleop_rt.cli.whole_run; from teleop_rt.kernels.jit import load_compiler; load_compiler()'

# Where Python may not write what it has compiled, every process would compile it all again.
compile_modules() {
  "$repo/.venv/bin/python" -m compileall -q "$repo/teleop_rt" "$repo/drivers" || true
  PYTHONDONTWRITEBYTECODE='' "$repo/.venv/bin/python" -c "$what_a_run_loads" || true
}

setup_venv() {
  local extras=$1 python stamp pinned log="$repo/.venv/setup.log"
  python=$(find_python) || exit 2
  stamp="$repo/.venv/teleop-rt.stamp"
  pinned=$(cat "$repo/pyproject.toml" "$repo/constraints.txt" | cksum)
  if ! installed "$stamp" "$pinned" "$extras"; then
    if ! command -v uv >/dev/null && ! "$python" -c 'import venv, ensurepip' 2>/dev/null; then
      echo "Python's venv module is missing; install it (Debian, Ubuntu: apt install python3-venv) and run this again." >&2
      exit 2
    fi
    mkdir -p "$repo/.venv" || exit 2
    if [ ! -x "$repo/.venv/bin/python" ]; then
      phase "environment $repo/.venv (once)" make_environment "$python" || exit 2
    fi
    phase "packages for $extras" install_packages "$extras" || {
      echo "Is a package index reachable?" >&2
      exit 2
    }
    phase "modules to bytecode" compile_modules
    installed "$stamp" "$pinned" "" || echo "$pinned" >"$stamp"
    echo "${extras//,/$'\n'}" >>"$stamp"
  fi
  PATH="$repo/.venv/bin:$PATH"
}
