// @vitest-environment happy-dom
import { cleanup, fireEvent, screen } from "@testing-library/preact";
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import { FakeService } from "../fakes";
import RecalibrateView from ".";
import { storeGuide } from "./progress";

const PARTS = /piston|cylinder|\brods?\b/i;

beforeEach(() => storeGuide("arm", null));
afterEach(cleanup);

function service(cylinder: object | null): FakeService {
  const fake = new FakeService("engineer");
  fake.resources["/machines/arm"] = { machine: { channels: [], joints: [{ name: "joint1", cylinder }] } };
  fake.resources["/recordings?machine=arm&limit=200"] = { items: [], next: null };
  return fake;
}

describe("a guided recalibration", () => {
  it("of a machine without cylinders speaks of none, and has no step for them", async () => {
    const { container } = service(null).show(<RecalibrateView />);
    await screen.findByText(/^A training motion is recorded twice/);
    expect(container.textContent).not.toMatch(PARTS);
    fireEvent.click(screen.getByRole("button", { name: "Begin" }));
    await screen.findByRole("list", { name: "Steps" });
    expect(screen.getAllByRole("listitem").map((item) => item.textContent?.replace(/^[i–]/, ""))).toEqual([
      "Check the sensors",
      "Record the training motion",
      "Record it once more",
      "Record another motion",
      "Identify",
    ]);
    expect(container.textContent).not.toMatch(PARTS);
  });

  it("of a machine with cylinders begins with them", async () => {
    service({ bore: 0.08, rod: 0.045 }).show(<RecalibrateView />);
    await screen.findByText(/each cylinder is moved alone/);
    fireEvent.click(screen.getByRole("button", { name: "Begin" }));
    await screen.findByText("Unpin the rods");
  });
});
