#!/bin/sh
# environment.sh VENV BPY|bake|tables|lint [EXTRA]: make the virtual environment VENV with this package in it, and with
# Blender's Python wheel BPY (and more of the package's extras), with what judges baked lenses, with what makes the
# tables of spectra, or with what checks the code. (Optiland and colour-science ask for other numpys than the wheel.)
# What packaging/lock-BPY.txt names is installed in exactly the versions and files that it names; all else is free.
# Of what judges baked lenses, rayoptics comes alone: it asks for Qt and Jupyter, 0.7 GB, that its tracer never loads.
# System libraries that these need come by apt where we are root; elsewhere one line says which to install.
set -eu
exec 9<"$0" && flock 9  # one at a time: what setuptools leaves in this folder, and apt's own lock, are one for all
venv=$1
alone=
libraries="libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libgl1"

case $2 in
bake) version=3.11 module=optiland.optic packages= extras=witness,plots,test
    alone="rayoptics==0.9.8 opticalglass==1.1.1 transforms3d==0.4.2" ;;
tables) version=3.11 module=colour packages= extras=tables ;;
lint) version=3.11 module=mypy packages= extras=lint ;;
4.5.* | 5.0.*) version=3.11 module=bpy packages="bpy==$2 numpy>=1.26,<2" extras=plots,test${3:+,$3} ;;
*) version=3.13 module=bpy packages="bpy==$2 numpy>=2.2,<3" extras=plots,test${3:+,$3} ;;
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

# The package's loops in C want a compiler; where there is none, and we may not install one, numpy does their work.
if [ -z "${CC:-}" ] && [ "$(id -u)" = 0 ] && ! command -v cc >/dev/null && command -v apt-get >/dev/null; then
    (install_packages "a C compiler is missing" gcc) || true
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
