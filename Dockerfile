# The image that builds: the compiler and its linker stay behind here.
FROM rust:1-slim-bookworm AS build
WORKDIR /src
COPY . .
# Locked, so that an image is made of what was tested.
RUN cargo build --release --locked --bin vfd-gateway

# Debian of the same release, for the C library that the program was linked with.
FROM debian:bookworm-slim
COPY --from=build /src/target/release/vfd-gateway /usr/local/bin/vfd-gateway
# A number and not a name, so that a host can see that it is not root. Access to a serial device comes from
# the group that the container is given (--group-add).
USER 10001:10001
EXPOSE 1502
ENTRYPOINT ["vfd-gateway"]
CMD ["run", "-c", "/etc/vfd-gateway/vfd-gateway.toml"]
