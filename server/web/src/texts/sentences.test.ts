import { describe, expect, it } from "vitest";
import { german } from "./said_de";

describe("sentences of the service", () => {
  it("of reports are those of `report.html`", () => {
    expect(
      german("move slowly through zero load in both directions; or change the pump's speed: the line moves with it"),
    ).toBe(
      "in beiden Richtungen langsam durch die Last null fahren; oder die Pumpendrehzahl ändern: Die Linie wandert mit",
    );
    expect(
      german("look after cable, plug and supply of this device, and mark the rows missing in arm.yaml lines 39 and 43"),
    ).toBe(
      "Kabel, Stecker und Versorgung dieses Geräts prüfen und die Zeilen als fehlend kennzeichnen in arm.yaml, Zeilen 39 und 43",
    );
    expect(german("paint it; or take the harness off and repeat")).toBe("paint it; or take the harness off and repeat");
    expect(german("joint1 and joint3 swing while joint2 creeps over its range; the others hold; or fast motions")).toBe(
      "joint1 und joint3 schwingen, während joint2 langsam durch seinen Bereich fährt; die anderen halten; oder schnelle Bewegungen",
    );
  });

  it("stay as they are where no table has them", () => {
    expect(german("bus 'can': no such interface 'can7'")).toBe("bus 'can': no such interface 'can7'");
  });
});
