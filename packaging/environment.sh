#!/bin/sh
# environment.sh VENV BPY|bake|tables|sensor|photographs|lint|release|site [EXTRA]: create the virtual environment VENV
# with this package and one of these: Blender's Python wheel BPY (with further extras of the package), the references for
# baked lenses, the requirements for the tables of spectra, the evaluator of sensors, Lensfun's data, the linters, the
# builder of sdist and wheel, or that of the site. (Optiland and colour-science need a different numpy than the wheel.)
# Packages in packaging/lock-BPY.txt are installed in exactly these versions and files; others are not pinned.
# rayoptics is installed without dependencies: it requires Qt and Jupyter, 0.7 GB, which its tracer never loads.
# Required system libraries are installed with apt for root; otherwise one line says which to install.
set -eu
exec 9<"$0" && flock 9  # one at a time: setuptools's files in this folder and apt's lock are shared
venv=$1
alone=
libraries="libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libgl1"

case $2 in
bake) version=3.11 module=optiland.optic packages= extras=witness,test
    alone="rayoptics==0.9.8 opticalglass==1.1.1 transforms3d==0.4.2" ;;
tables) version=3.11 module=colour packages= extras=tables ;;
sensor) version=3.11 module=emva1288.process.results packages= extras=emva,judges,test ;;
photographs) version=3.11 module=lensfunpy packages= extras=lensfun,test ;;
lint) version=3.11 module=mypy packages= extras=lint ;;
release) version=3.11 module=build packages= extras=release ;;
site) version=3.11 module=sphinx packages= extras=site ;;
4.2.* | 4.5.* | 5.0.*) version=3.11 module=bpy packages="bpy==$2 numpy>=1.26,<2" extras=gpu,test${3:+,$3} ;;
*) version=3.13 module=bpy packages="bpy==$2 numpy>=2.2,<3" extras=gpu,test${3:+,$3} ;;
esac

install_packages() { # install_packages WHY PACKAGE...
    why=$1
    shift
    if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
        echo "lensfield: $why: please install: $*  (on Debian or Ubuntu: sudo apt-get install $*)" >&2
        exit 1
    fi
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

for python in "python$version" python3 "$HOME/.pyenv/versions/$version".*/bin/python; do
    "$python" -c "import sys; sys.exit('%d.%d' % sys.version_info[:2] != '$version')" 2>/dev/null && break
    python=
done
if [ -z "$python" ]; then
    echo "lensfield: $2 needs Python $version: please install it (Debian 12 and Ubuntu have python$version)" >&2
    exit 1
fi
"$python" -c 'import ensurepip' 2>/dev/null ||
    install_packages "Python's venv module is missing" "python$version-venv"

# The package's C loops require a compiler. If none is installed and none can be, numpy is used instead.
if [ -z "${CC:-}" ] && [ "$(id -u)" = 0 ] && ! command -v cc >/dev/null && command -v apt-get >/dev/null; then
    (install_packages "a C compiler is missing" gcc) || true
fi

# Wheels contain the C loops of all platforms. build_wheels.py reports the compilers that are still missing.
if [ "$2" = release ] && ! { command -v aarch64-linux-gnu-gcc && command -v x86_64-w64-mingw32-gcc &&
    command -v clang && command -v ld.lld; } >/dev/null; then
    (install_packages "cross compilers are missing" gcc gcc-aarch64-linux-gnu gcc-mingw-w64-x86-64 clang lld) || true
fi

# Without a graphics card, the tests of casting on a GPU require Mesa's emulation of one. Otherwise they are skipped.
if [ -z "${extras##gpu,*}" ] && [ "$(id -u)" = 0 ] && ! ls /usr/share/vulkan/icd.d/lvp_icd* >/dev/null 2>&1 &&
    command -v apt-get >/dev/null; then
    (install_packages "an emulated GPU is missing" mesa-vulkan-drivers) || true
fi

"$python" -m venv "$venv"
lock="packaging/lock-$2.txt"
if [ -f "$lock" ] && [ "$(uname -sm)" = "Linux x86_64" ]; then
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps -r "$lock"
fi
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --report "$venv/installed.json" $packages \
    -e ".[$extras]"
[ -z "$alone" ] || "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps $alone
"$venv/bin/python" -c "import $module" 2>/dev/null ||
    install_packages "$module needs system libraries" $libraries
"$venv/bin/python" -c "import $module, lensfield.engine"
touch "$venv/.ready"
