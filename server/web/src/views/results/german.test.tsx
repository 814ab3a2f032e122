// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import content from "./report.fixture.json";

vi.mock("../../ui/plot", () => ({ Plot: ({ title }: { title: string }) => <figure>{title}</figure> }));
vi.mock("../../charts/xy_chart", () => ({ XyChart: () => null }));
vi.mock("../../charts/time_chart", () => ({ TimeChart: () => null }));

vi.setConfig({ testTimeout: 60_000 });
// What is drawn with the German table: each module is read anew, since texts of tables are made as it is read.
beforeEach(() => {
  localStorage.setItem("hilfit.language", "de");
  vi.resetModules();
});
afterEach(() => {
  localStorage.removeItem("hilfit.language");
  vi.resetModules();
});

async function shown(report: unknown) {
  const { FakeService } = await import("../fakes");
  const { ResultPage } = await import("./result");
  await (
    await import("../../texts/report")
  ).tables;
  const fake = new FakeService("viewer");
  const identification = { id: "idn-1", machine: "arm", label: "X", job: "job-1", verdict: "effect_added", overall: 1 };
  fake.resources["/identifications/idn-1"] = identification;
  fake.resources["/identifications/idn-1/report.json"] = report;
  return fake.show(<ResultPage id="idn-1" />);
}

it("says the verdict, the cause and what to do in German", async () => {
  const gains = { code: "fitting.gains_chi_square", values: { gain: 8136.4 } };
  const accepted = content.loop.candidates.find((one) => one.status === "accepted");
  const messages = {
    [accepted?.reason ?? ""]: gains,
    "significant, but another effect explains the same better": {
      code: "fitting.significant_but_another_effect",
      values: {},
    },
    [content.warnings[0] ?? ""]: { code: "daq.named", values: { name: "joint2", what: gains } },
  };
  const { findByText, container } = await shown({ ...content, messages });
  await findByText(/^Dem Modell fehlte: Reibung, die vom Kolbenweg abhängt \(an joint2; /);
  const text = container.textContent ?? "";
  expect(text).toContain("der aller Gelenke zusammen sank um 33\u202f%");
  for (const question of ["Was fehlte?", "Wie sicher ist das?", "Wie viel besser ist es?", "Was ist zu tun?"])
    expect(text).toContain(question);
  expect(text).toContain("1,86");
  expect(text).toContain("verbessert Chi-Quadrat um 8136");
  expect(text).toContain("joint2: verbessert Chi-Quadrat um 8136");
  expect(text).not.toMatch(/\b(the|missing|piston|validation|before|after|left|is)\b/);
});
