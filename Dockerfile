# Debian 13 with its own DOLFINx 0.9: every dependency comes from apt, pip asks no network.
#   docker build -t ruptfx:0.2.0 -t ruptfx . && docker run --rm -v "$PWD/out:/out" ruptfx
FROM debian:trixie-slim
LABEL org.opencontainers.image.title=ruptfx org.opencontainers.image.version=0.2.0 org.opencontainers.image.licenses=MIT

# gcc, libc6-dev and python3-dev: FFCx and ruptfx compile C at run time.  libopenblas0-pthread: else reference BLAS.
# A test keeps this list equal to the dependencies in pyproject.toml.
RUN apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        python3-dolfinx libopenblas0-pthread gcc libc6-dev python3-dev python3-pip python3-setuptools \
        python3-numpy python3-scipy python3-pydantic python3-typer python3-rich python3-h5py python3-h5netcdf \
        python3-xarray python3-matplotlib python3-pil python3-tomli-w python3-dask python3-distributed python3-gmsh \
        python3-meshio python3-pytest python3-pytest-xdist python3-hypothesis \
    && rm -rf /var/lib/apt/lists/*

# Open MPI: may run as root, on more ranks than cores, without binding two jobs to the same core; shared memory only,
# by copying (a container may forbid to read another process's memory).  Anyone may make a cache there, for --user.
ENV OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_btl=self,sm OMPI_MCA_smsc=^cma \
    PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe PRTE_MCA_hwloc_default_binding_policy=none \
    OMP_NUM_THREADS=1 MPLBACKEND=Agg LC_ALL=C.UTF-8 PYTHONDONTWRITEBYTECODE=1 \
    XDG_CACHE_HOME=/var/cache/ruptfx MPLCONFIGDIR=/var/cache/ruptfx/matplotlib
RUN mkdir -m 1777 "$XDG_CACHE_HOME" /out

WORKDIR /app
COPY pyproject.toml README.md LICENSE ./
COPY ruptfx ruptfx
COPY demos demos
# --no-index: fails if apt's packages do not satisfy pyproject.toml.
RUN pip install --quiet --break-system-packages --root-user-action=ignore --no-build-isolation --no-index '.[study]' \
    && rm -rf build ruptfx ruptfx.egg-info

# Proves the image on two ranks.  What it compiled is root's, and would not be loaded by another user.
RUN ruptfx run demos/impact.toml --ranks 2 --out /tmp/proof --set mesh.element_size=4e-3 --set duration=5e-6 \
    && rm -rf /tmp/proof "$XDG_CACHE_HOME/ruptfx" && chmod -R a+rwX "$XDG_CACHE_HOME"

CMD ["ruptfx", "run", "demos/impact.toml", "--ranks", "2", "--out", "/out/impact"]
