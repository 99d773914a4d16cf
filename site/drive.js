// Plays a recording on the map of its report.
"use strict";
(() => {
    const { every, columns, samples, lines, at, scale } = JSON.parse(document.getElementById("recording").textContent);
    const drive = document.getElementById("drive");
    const [button, slider, output, log] = ["button", "input", "output", "pre"].map((name) => drive.querySelector(name));
    const vehicle = document.createElementNS("http://www.w3.org/2000/svg", "path");
    // An arrow of the size of an R150: 0.8 m long, with its nose where it heads to.
    vehicle.setAttribute("d", "M 0.4 0 L 0.2 0.3 L -0.4 0.3 L -0.4 -0.3 L 0.2 -0.3 Z");
    vehicle.id = "vehicle";
    vehicle.setAttribute("fill", "#0a66c2");
    vehicle.setAttribute("fill-opacity", "0.8");
    drive.querySelector("svg").append(vehicle);
    const end = (samples.length - 1) * every;
    slider.max = end;

    const show = (time) => {
        const values = samples[Math.min(Math.round(time / every), samples.length - 1)];
        const now = Object.fromEntries(columns.map((name, index) => [name, values[index]]));
        const place = [at[0] + now["truth.x_m"] * scale, at[1] - now["truth.y_m"] * scale];
        vehicle.setAttribute("transform", `translate(${place}) rotate(${-now["truth.heading_deg"]}) scale(${scale})`);
        output.textContent = `${time.toFixed(1)} s, ${now["truth.speed_mps"].toFixed(2)} m/s`;
        log.textContent = lines.filter((line) => parseFloat(line) <= time).slice(-8).join("\n");
        slider.value = time;
    };
    let began = null;
    const tick = () => {
        if (began === null) return;
        const time = (performance.now() - began) / 1000;
        show(Math.min(time, end));
        if (time < end) requestAnimationFrame(tick);
        else stop();
    };
    const stop = () => {
        began = null;
        button.textContent = "Play";
    };
    button.addEventListener("click", () => {
        if (began !== null) return stop();
        const from = Number(slider.value) >= end ? 0 : Number(slider.value);
        began = performance.now() - from * 1000;
        button.textContent = "Stop";
        tick();
    });
    slider.addEventListener("input", () => {
        stop();
        show(Number(slider.value));
    });
    show(0);
})();
