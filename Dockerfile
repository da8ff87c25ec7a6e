# The image that builds: the compiler and its linker stay behind here.
FROM rust:1-slim-bookworm AS build
WORKDIR /src
COPY . .
# Locked, so that an image is made of what was tested.
RUN cargo build --release --locked --bin vfd-gateway && mkdir /data

# Debian of the same release, for the C library that the program was linked with.
FROM debian:bookworm-slim
COPY --from=build /src/target/release/vfd-gateway /usr/local/bin/vfd-gateway
# Whom to trust where `mqtts://` has no `ca_file`; the slim image has nobody.
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt
# For `data_dir`. A volume that is mounted here for the first time takes this owner over.
COPY --from=build --chown=10001:10001 /data /var/lib/vfd-gateway
# A number and not a name, so that a host can see that it is not root. Access to a serial device comes from
# the group that the container is given (--group-add).
USER 10001:10001
# Modbus TCP, as the examples have it. HTTP is on loopback only and has nothing to expose.
EXPOSE 1502
# No HEALTHCHECK: `vfd-gateway health` needs a `data_dir`, and fails while one line or the broker is away. A restart for
# that would carry out `on_shutdown` on the drives of all other lines.
#
# SIGTERM carries out `on_shutdown`, which takes up to 7 s; Docker's 10 s are enough.
ENTRYPOINT ["vfd-gateway"]
CMD ["run", "-c", "/etc/vfd-gateway/vfd-gateway.toml"]
