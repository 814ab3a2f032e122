import { describe, expect, it } from "vitest";
import { german } from "./said_de";

describe("sentences of the service", () => {
  it("keep names and get the decimal sign of the language", () => {
    expect(german("no measurement from joint1.angle, joint2.angle; check the sensor and its cable")).toBe(
      "Keine Messung von joint1.angle, joint2.angle; den Aufnehmer und sein Kabel prüfen",
    );
    expect(
      german(
        "joint2: measured and predicted effort differ by +12.5 N m, 7.3 times the band (limit 4.1): a collision or an overload; look at the arm",
      ),
    ).toBe(
      "joint2: gemessene und vorhergesagte Kraftgröße unterscheiden sich um +12,5 N m, das 7,3-Fache des Bands (Grenze 4,1): Kollision oder Überlast; den Arm ansehen",
    );
  });

  it("look up what stands in them, also in lists and behind a joint's name", () => {
    expect(
      german(
        "measured and predicted effort drift apart: joint1: a constant force more or less; joint3: more or less force against the motion (friction); recalibrate, or look for the cause",
      ),
    ).toBe(
      "Gemessene und vorhergesagte Kraftgröße laufen auseinander: joint1: eine gleichbleibende Kraft mehr oder weniger; joint3: mehr oder weniger Kraft gegen die Bewegung (Reibung); neu kalibrieren oder die Ursache suchen",
    );
    expect(
      german(
        "speeds drift from what the valves gave: boom: the edge of extending has moved by -0.0208 of full command (standard deviation 0.0005); jib: the delay of retracting seems to have moved; look at the valve and its amplifier, or identify it again",
      ),
    ).toBe(
      "Geschwindigkeiten weichen von dem ab, was die Ventile gaben: boom: die Kante beim Ausfahren hat sich um -0,0208 vom vollen Stellwert verschoben (Standardabweichung 0,0005); jib: die Verzögerung beim Einfahren scheint sich verschoben zu haben; das Ventil und seinen Verstärker ansehen oder neu identifizieren",
    );
    expect(german("Stage 1: each drive's friction and stiffness: failed")).toBe(
      "Stufe 1: Reibung und Steifigkeit jedes Antriebs: fehlgeschlagen",
    );
  });

  // `test_page_texts.py` holds `report.html` to the same.
  it("of reports are those of `report.html`", () => {
    expect(
      german("move slowly through zero load in both directions; or change the pump's speed: the line moves with it"),
    ).toBe(
      "in beiden Richtungen langsam durch die Last null fahren; oder die Pumpendrehzahl ändern: Die Linie wandert mit",
    );
    expect(german("a.mf4: resampled from 99.5 Hz to 100 Hz; 0.02 s beside gaps and at the ends are left out")).toBe(
      "a.mf4: von 99,5 Hz auf 100 Hz umgetastet; 0,02 s neben Lücken und an den Enden sind weggelassen",
    );
    expect(
      german("look after cable, plug and supply of this device, and mark the rows missing in arm.yaml lines 39 and 43"),
    ).toBe(
      "Kabel, Stecker und Versorgung dieses Geräts prüfen und die Zeilen als fehlend kennzeichnen in arm.yaml, Zeilen 39 und 43",
    );
    expect(german("paint it; or take the harness off and repeat")).toBe("paint it; or take the harness off and repeat");
    expect(
      german(
        "joint1: validate moves where the training motions tell little: an error of 1.89e+14 N m is to be expected there, 2.5 N m on those motions; train on a motion that goes there",
      ),
    ).toBe(
      "joint1: validate bewegt sich, wo die Anregungsbewegungen wenig sagen: Dort ist ein Fehler von 1,89e+14 N m zu erwarten, 2,5 N m auf jenen Bewegungen; mit einer Bewegung anregen, die dorthin geht",
    );
    expect(german("joint1 and joint3 swing while joint2 creeps over its range; the others hold; or fast motions")).toBe(
      "joint1 und joint3 schwingen, während joint2 langsam durch seinen Bereich fährt; die anderen halten; oder schnelle Bewegungen",
    );
  });

  it("stay as they are where no table has them", () => {
    expect(german("bus 'can': no such interface 'can7'")).toBe("bus 'can': no such interface 'can7'");
  });
});

describe("refusals and findings", () => {
  it("of requests", () => {
    expect(german("machine 'arm' is being recorded as rec-7; stop that recording first")).toBe(
      "Die Maschine „arm“ wird gerade als rec-7 aufgezeichnet; diese Aufzeichnung zuerst beenden",
    );
    expect(german("calibration 'cal-1' is proposed; it has to be approved before it is used")).toBe(
      "Die Kalibrierung „cal-1“ hat den Zustand: vorgeschlagen; vor dem Gebrauch muss sie freigegeben werden",
    );
  });

  it("of machine files, with file, line and key as they are", () => {
    expect(german("arm.yaml:14: joints[0].cylinder.bor: unknown key; did you mean 'bore'? (and 2 more)")).toBe(
      "arm.yaml:14: joints[0].cylinder.bor: unbekannter Schlüssel; war „bore“ gemeint? (und 2 weitere)",
    );
  });

  it("of checks, put together as the checks do", () => {
    expect(
      german(
        "boom: boom.angle looks as if it counted the other way (the two sensors disagree by 12% of the motion as it is, by 0.3% then)",
      ),
    ).toBe(
      "boom: boom.angle zählt anscheinend andersherum (die beiden Aufnehmer unterscheiden sich jetzt um 12% der Bewegung, dann um 0,3%)",
    );
    expect(german("correct the sign of its scale in arm.yaml line 88")).toBe(
      "das Vorzeichen von scale berichtigen in arm.yaml, Zeile 88",
    );
    expect(
      german("boom.head: shows 3.2 bar without pressure; if there is none, write offset: -3.2 in its source"),
    ).toBe("boom.head: zeigt drucklos 3,2 bar; wenn kein Druck da ist, offset: -3,2 in seine Quelle schreiben");
  });

  it("are not half translated where a part is unknown to the tables", () => {
    for (const text of ["the pump looks tired", "arm.yaml: its colour is wrong; paint it", ""])
      expect(german(text)).toBe(text);
  });
});
