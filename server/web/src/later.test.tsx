// @vitest-environment happy-dom
import { cleanup, fireEvent, render, screen } from "@testing-library/preact";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

const OWN = "./assets/page-0ldv3rsn.js";
const gone = (): Promise<never> => Promise.reject(new TypeError("Failed to fetch dynamically imported module"));

beforeEach(() => {
  const script = document.createElement("script");
  script.setAttribute("type", "module");
  vi.spyOn(document, "querySelector").mockImplementation((of) => (of.startsWith("script") ? script : null));
  script.setAttribute("src", OWN);
});
afterEach(() => {
  cleanup();
  localStorage.clear();
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
  vi.resetModules();
});

/** A view whose file is fetched so, while the service has this page. */
async function shown(fetched: () => Promise<{ default: () => string }>, index: Response | null, language = "en") {
  localStorage.setItem("hilfit.language", language);
  vi.stubGlobal("fetch", async () => (index === null ? Promise.reject(new TypeError()) : index.clone()));
  const { later } = await import("./later");
  const View = later(fetched);
  render(<View />);
}
const page = (script: string) => new Response(`<script type="module" src="${script}"></script>`);

it.each([
  [
    "en",
    "The service was upgraded while this page was open. Load the page again to see this view.",
    "Load the page again",
  ],
  [
    "de",
    "Der Dienst wurde aktualisiert, während diese Seite offen war. Laden Sie die Seite neu, um diese Ansicht zu sehen.",
    "Seite neu laden",
  ],
])("says in '%s' that the service was upgraded, and offers the new page", async (language, text, offer) => {
  const reload = vi.fn();
  await shown(gone, page("./assets/page-n3wv3rsn.js"), language);
  expect((await screen.findByRole("alert")).textContent).toContain(text);
  vi.stubGlobal("location", { reload });
  expect(reload).not.toHaveBeenCalled();
  fireEvent.click(screen.getByRole("button", { name: offer }));
  expect(reload).toHaveBeenCalledOnce();
});

it.each([
  ["has the page as it is", page(OWN)],
  ["does not answer", null],
  ["refuses", new Response("busy", { status: 503 })],
])("tries again when asked where the service %s", async (_what, index) => {
  let answers = false;
  await shown(async () => (answers ? { default: () => "the view" } : gone()), index);
  expect((await screen.findByRole("alert")).textContent).toContain("The service did not answer");
  answers = true;
  fireEvent.click(screen.getByRole("button", { name: "Try again" }));
  expect(await screen.findByText("the view")).toBeTruthy();
});
