// A live vehicle on a page: its button loads the page of a system, beside this script, into a frame.
(function () {
  const folder = document.currentScript.src.replace(/[^/]*$/, "");
  function begin(place, html) {
    const frame = document.createElement("iframe"), notice = place.querySelector("[role=status]");
    frame.title = `live page of ${place.dataset.vehicle}`;
    frame.onload = async () => {
      const inner = frame.contentWindow, theme = document.body.dataset.theme;
      if (theme === "light" || theme === "dark") inner.document.documentElement.dataset.theme = theme;
      for (let tries = 0; !inner.uuvsimPage && tries < 200; tries++) await new Promise(r => setTimeout(r, 50));
      if (inner.uuvsimPage) inner.uuvsimPage.run();  // otherwise, the page says why not
      place.dataset.state = inner.uuvsimPage ? "running" : "failed";
    };
    frame.srcdoc = html;
    const own = document.createElement("a");
    own.textContent = "Open it in a tab of its own";
    own.href = URL.createObjectURL(new Blob([html], { type: "text/html" }));
    own.target = "_blank";
    notice.replaceChildren(own);
    place.querySelector(".live-poster").replaceWith(frame);
  }
  globalThis.uuvsimVehicle = (name, html) => {
    for (const place of document.querySelectorAll(`[data-vehicle="${name}"]`)) begin(place, html);
  };
  for (const place of document.querySelectorAll("[data-vehicle]")) place.querySelector("button").onclick = () => {
    const script = document.createElement("script"), notice = place.querySelector("[role=status]");
    notice.textContent = "loading …";
    script.src = `${folder}${place.dataset.vehicle}.js`;
    script.onerror = () => { notice.textContent = `The file ${script.src} cannot be read.`; };
    document.head.append(script);
  };
})();
