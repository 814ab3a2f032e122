import "uplot/dist/uPlot.min.css";
import "./styles/tokens.css";
import "./styles/base.css";
import "./styles/controls.css";
import "./styles/layout.css";
import "./styles/views.css";
import { render } from "preact";
import { App } from "./app";
import { fetchViews } from "./later";
import { Connection } from "./net/connection";
import { watchWaking } from "./net/wake";
import { SessionContext } from "./session";
import { language } from "./texts/language";

document.documentElement.lang = language;
const connection = new Connection();
connection.start();
watchWaking(() => connection.woke());
// A page that the browser keeps in its cache must not hold connections, or it is not kept.
window.addEventListener("pagehide", () => connection.stop());
window.addEventListener("pageshow", (event) => {
  if (event.persisted) connection.start();
});
render(
  <SessionContext.Provider value={connection}>
    <App />
  </SessionContext.Provider>,
  document.getElementById("page") as HTMLElement,
);
fetchViews();
