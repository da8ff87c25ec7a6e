# The program, the C library that it is linked with, and whom to trust: nothing else. docs/container.md says how it is
# built, for other machines and without a network too, and how it is run.

ARG RUST=1.95.0
ARG DEBIAN=bookworm

# Runs on the machine that builds and compiles for the one that is wanted, which the builder names. The compiler and its
# linker stay behind here.
FROM --platform=$BUILDPLATFORM rust:${RUST}-slim-${DEBIAN} AS build
ARG TARGETARCH
ARG TARGETVARIANT
WORKDIR /src
COPY deploy/container/build.sh /build.sh
RUN /build.sh tools
COPY . .
# The program of a version that is not a release shows its commit.
ARG REVISION
RUN VFD_GATEWAY_BUILD=$REVISION /build.sh program

# Debian as the wanted machine has it. Its files are taken, and nothing of it is run.
FROM debian:${DEBIAN}-slim AS debian

FROM build AS root
ARG TARGETARCH
ARG TARGETVARIANT
RUN --mount=type=bind,from=debian,source=/,target=/debian /build.sh root /debian /image && install -d -m 700 /data/vfd-gateway

FROM scratch
ARG VERSION=0.9.0-dev
ARG REVISION=unknown
LABEL org.opencontainers.image.title="vfd-gateway" \
      org.opencontainers.image.description="Bridges variable-frequency drives on serial lines to Modbus TCP and MQTT" \
      org.opencontainers.image.licenses="Apache-2.0 OR MIT" \
      org.opencontainers.image.version="${VERSION}" \
      org.opencontainers.image.revision="${REVISION}"
COPY --from=root /image /
# For `data_dir`. A volume that is mounted here for the first time takes this owner over.
COPY --from=root --chown=10001:10001 /data /var/lib
ENV PATH=/usr/local/bin
# A number and not a name, so that a host can see that it is not root. Access to a serial device comes from
# the group that the container is given (--group-add).
USER 10001:10001
# Modbus TCP, as the examples have it. HTTP is on loopback only and has nothing to expose.
EXPOSE 1502
# Whether the program turns and no line hangs: that alone may have a container started anew. A line or a broker that is
# away may not, because a restart carries out `on_shutdown` on the drives of all other lines. It asks over the socket in
# `data_dir` and not by the configuration: one that somebody is just editing says nothing of the gateway that runs.
HEALTHCHECK --interval=10s --timeout=6s --start-period=15s --retries=3 CMD ["vfd-gateway", "health", "--alive"]
# SIGTERM carries out `on_shutdown`, which takes up to 7 s; Docker's 10 s are enough.
STOPSIGNAL SIGTERM
ENTRYPOINT ["vfd-gateway"]
CMD ["run", "-c", "/etc/vfd-gateway/vfd-gateway.toml"]
