# docker build -t taxelflow . && mkdir -p demo
# docker run --rm --user "$(id -u):$(id -g)" -v "$PWD/demo:/work/demo" taxelflow
# Runs the paper's experiment on the simulated hand; results and a report are in /work/demo.
FROM python:3.12-slim
WORKDIR /opt/taxelflow
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY src ./src
RUN pip install --no-cache-dir --constraint constraints.txt ".[plot,report,video,tables]" \
    && useradd --create-home taxelflow && mkdir /work && chown taxelflow /work
USER taxelflow
WORKDIR /work
# Any user can write there: the one who owns demo/ runs the container.
ENV HOME=/tmp NUMBA_CACHE_DIR=/tmp/numba
CMD mkdir -p demo \
    && taxelflow simulate stroke --out demo/stroke.npz \
    && taxelflow estimate demo/stroke.npz --method convolution --out demo/convolution \
    && taxelflow estimate demo/stroke.npz --method template --out demo/template \
    && taxelflow report demo/convolution demo/template --out demo/report.html
