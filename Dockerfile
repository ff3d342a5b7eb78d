# Fast-SegSim on Debian 12: `docker build -t segsim . && docker run --rm segsim --help`.
# The packages are those of tools/debian_packages.txt; the second image gets the program and what it links.
FROM debian:12 AS build
WORKDIR /source
COPY tools/debian_packages.txt tools/
RUN apt-get update && grep -v '^#' tools/debian_packages.txt | \
    DEBIAN_FRONTEND=noninteractive xargs apt-get install -y --no-install-recommends
COPY . .
RUN cmake --preset release -DSEGSIM_TESTS=OFF && cmake --build --preset release && \
    cd build/release && cpack -G DEB

FROM debian:12
COPY --from=build /source/build/release/segsim_*.deb /tmp/
RUN apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends /tmp/segsim_*.deb && \
    rm -r /tmp/segsim_*.deb /var/lib/apt/lists
# Specs and trials that came with the program are found by their names: segsim run experiments/specs/flat.yaml
WORKDIR /work
ENTRYPOINT ["segsim"]
